"""The joint distribution of readings that a fit keeps, against least squares and sample moments by numpy."""

import numpy as np
import pytest

from ambient_model.model import ReadingModel
from ambient_model.observer import Observer
from ambient_model.tracking import Tracker
from ambient_trainer.data.trace import Trace
from ambient_trainer.estimators.base import Effort
from ambient_trainer.estimators.library.free import FreeFilterEstimator
from ambient_trainer.estimators.model_file import model_of
from ambient_trainer.estimators.readings import reading_model

SAMPLES = 4000
SENSORS = 3
BLOCKS = 10
GATE_MARGIN = 1.75
START_OFFSET_DEGC = 0.2


@pytest.fixture(scope="module")
def trace():
    """Sensors between the ambient and a body that a load heats, each with a lag and noise of its own."""
    random = np.random.default_rng(2)
    ambient = np.repeat(random.uniform(10, 30, 8), SAMPLES // 8)
    load = np.repeat(random.choice([0.0, 4.0, 9.0], 40), SAMPLES // 40)
    true = np.zeros((SENSORS, SAMPLES))
    true[:, 0] = ambient[0]
    for k in range(1, SAMPLES):
        rise = np.array([1.0, 0.5, 0.2]) * load[k]
        true[:, k] = true[:, k - 1] + (ambient[k] + rise - true[:, k - 1]) / np.array([40.0, 120.0, 300.0])
    read = true + random.normal(size=true.shape) * np.array([[0.05], [0.1], [0.02]])
    names = ("soc_degC", "usb_degC", "battery_degC")
    return Trace("drawn.csv", np.arange(SAMPLES) * 1.0, {**dict(zip(names, read)), "ambient_degC": ambient})


@pytest.fixture(scope="module")
def fitted(trace):
    fit = FreeFilterEstimator(1).fit([trace], Effort(starts=1))
    return fit, reading_model(fit, [trace])


@pytest.fixture(scope="module")
def z(trace, fitted):
    """Readings and low-pass filters (N, entries), by the device's recursion."""
    fit, readings = fitted
    u = np.column_stack([trace.column(each) for each in fit.inputs])
    rows, lows = [], np.tile(u[0], (len(readings.lags_s), 1))
    a = 1 - np.exp(-1.0 / np.array(readings.lags_s))[:, None]
    for k in range(len(u)):
        if k:
            lows = lows + a * (u[k - 1] - lows)
        rows.append([*u[k], *lows.ravel()])
    return np.array(rows)


def added_noise(readings: ReadingModel, z: np.ndarray) -> np.ndarray:
    """Standard deviations that the file's covariance has beyond the sample covariance: on its diagonal alone."""
    excess = np.linalg.inv(np.array(readings.precision)) - np.cov(z.T, bias=True)
    assert np.abs(excess - np.diag(np.diag(excess))).max() < 1e-7
    return np.sqrt(np.diag(excess))


def regressed(z: np.ndarray, deviations: np.ndarray, i: int):
    """Mean and coefficients of reading i on the other sensors' entries, by least squares on z with noise added."""
    others = [column for column in range(z.shape[1]) if column % SENSORS != i]
    mean = z.mean(axis=0)
    rows = np.vstack([z[:, others] - mean[others], np.sqrt(len(z)) * np.diag(deviations[others])])
    wanted = np.concatenate([z[:, i] - mean[i], np.zeros(len(others))])
    found, *_ = np.linalg.lstsq(rows, wanted, rcond=None)
    return mean, others, found


def test_mean_and_covariance_are_the_samples_with_the_readings_noise(fitted, z):
    readings = fitted[1]
    assert readings.mean == pytest.approx(z.mean(axis=0))
    deviations = added_noise(readings, z).reshape(-1, SENSORS)
    order = [("soc", 0.05), ("usb", 0.1), ("battery", 0.02)]
    noise = np.array([dict(order)[each.removesuffix("_degC")] for each in fitted[0].inputs])
    ratio = deviations / noise
    assert min(abs(np.log(ratio.mean() / each)) for each in (0.3, 1.0, 3.0, 10.0)) < np.log(1.1)
    assert np.ptp(ratio) < 0.2 * ratio.mean()


def test_a_start_is_the_state_that_the_sensors_differences_tell(trace, fitted, z):
    fit, readings = fitted
    model = model_of(fit, [], {}, readings)
    [discrete] = [each for each in model.main.discrete if each.period_s == 1.0]
    rest, [[expected]] = np.array(model.main.initial)[0], readings.starts
    u = z[:, :SENSORS]
    x = [rest @ u[0]]
    for row in u[:-1]:
        x.append(discrete.A[0][0] * x[-1] + np.dot(discrete.B[0], row))
    noise = np.sqrt(len(u)) * np.diag(np.hypot(added_noise(readings, z)[:SENSORS], START_OFFSET_DEGC))
    differences = np.vstack([u, noise]) @ (np.eye(SENSORS) - 1 / SENSORS)
    found, *_ = np.linalg.lstsq(differences, np.concatenate([x - u @ rest, np.zeros(SENSORS)]), rcond=None)
    assert expected == pytest.approx(rest + found, rel=1e-6)
    first = Observer(model, Tracker(model.main, discrete)).update(0.0, u[0].tolist()).ambient_degC
    estimate = discrete.C[0][0] * np.dot(expected, u[0]) + np.dot(discrete.D[0], u[0]) + model.main.offset
    assert first == pytest.approx(estimate)


@pytest.mark.parametrize("i", range(SENSORS))
def test_limits_are_those_of_readings_that_the_others_make_expect(fitted, z, i):
    """A gate holds the largest difference on a block of time, expected from the other blocks; a turn three times what
    no other movement explains, a start every equilibrium."""
    deviations, limits = added_noise(fitted[1], z), fitted[1].sensors[i]

    def differences(rows, known):
        mean, others, found = regressed(known, deviations, i)
        return rows[:, i] - mean[i] - (rows[:, others] - mean[others]) @ found

    blocks = np.array_split(np.arange(len(z)), BLOCKS)
    largest = max(np.abs(differences(z[block], np.delete(z, block, axis=0))).max() for block in blocks)
    assert limits.gate == pytest.approx(GATE_MARGIN * largest, rel=1e-6)
    others = regressed(z, deviations, i)[1]
    beyond = np.abs(np.diff(differences(z, z))) - np.abs(np.diff(z[:, others], axis=0)).max(axis=1)
    assert limits.turn == pytest.approx(max(1.0, 3 * beyond.max()), rel=1e-6)
    at_rest = np.tile(z[:, :SENSORS], z.shape[1] // SENSORS)
    assert limits.start == pytest.approx(np.abs(differences(at_rest, z)).max(), rel=1e-6)


@pytest.mark.parametrize(("sensors", "samples"), [(1, 15), (1, 60), (3, 120)])
@pytest.mark.parametrize("lie", [-40.0, 0.0, 125.0])
def test_a_short_log_is_enough_to_refuse_a_lie(trace, sensors, samples, lie):
    columns = tuple(("soc_degC", "usb_degC", "battery_degC")[:sensors])
    rare = slice(None, None, SAMPLES // samples)
    short = Trace("short.csv", trace.time_s[rare], {name: row[rare] for name, row in trace.columns.items()})
    fit = FreeFilterEstimator(1).fit([short], Effort(starts=1), None, None, columns)
    model = model_of(fit, [], {}, reading_model(fit, [short]))
    observer = Observer(model, Tracker(model.main, model.main.discrete[-1]))
    u = np.column_stack([short.column(each.column) for each in model.main.inputs])
    u[samples // 2 :, 0] = lie
    found = [observer.update(*each) for each in zip(short.time_s.tolist(), u.tolist())]
    assert "tracking" not in {each.status for each in found[samples // 2 :]}


@pytest.mark.parametrize(("stop", "period_s", "stride"), [(1000, 0.1, 10), (600, 0.001, 300)])
def test_a_stretch_of_less_than_a_second_says_nothing_of_changes_within_one(trace, stop, period_s, stride):
    time_s = np.append(np.arange(stop), 1e6 + np.arange(5)) * period_s
    part = Trace("short.csv", time_s, {name: row[: stop + 5] for name, row in trace.columns.items()})
    found = reading_model(FreeFilterEstimator(1).fit([part], Effort(starts=1)), [part])
    assert round(found.jump_s / period_s) == stride


def test_a_current_beside_a_temperature_is_not_judged(trace):
    current = np.repeat(np.random.default_rng(4).choice([0.0, 1.0, 2.5], 40), SAMPLES // 40)
    columns = {**trace.columns, "charge_A": current}
    fit = FreeFilterEstimator(1).fit(
        [Trace("drawn", trace.time_s, columns)], Effort(starts=1), None, None, ("soc_degC", "charge_A")
    )
    readings = reading_model(fit, [Trace("drawn", trace.time_s, columns)])
    own = readings.sensors[fit.inputs.index("charge_A")]
    assert min(own.jump, own.still_s) > 1e6
    assert own.turn == 0
    assert readings.sensors[fit.inputs.index("soc_degC")].jump < 20
    assert np.array(readings.offset_gains)[fit.inputs.index("charge_A")] == pytest.approx(0.0)
