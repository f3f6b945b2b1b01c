"""The device's recursion and the numpy path say the same of thousands of samples, to 1e-9 degC."""

import sys

import numpy as np
import pandas as pd
import pytest
from scipy.signal import cont2discrete, dlsim, lfilter

from ambient_model.codec import decode, encode, save_model
from ambient_model.conformance import run_recursion
from ambient_model.model import Beyond, ErrorVariance, Secondary, Term
from ambient_model.observer import Observer
from ambient_model.trace import write_trace
from ambient_model.tracking import Tracker
from ambient_trainer.circuits.schema import load_circuit
from ambient_trainer.data.grid import Segment
from ambient_trainer.estimation.circuit_structure import CircuitStructure
from ambient_trainer.estimation.error_variance import sigma_degC
from ambient_trainer.estimation.search import Budget
from ambient_trainer.estimators.base import Effort
from ambient_trainer.estimators.estimate import blended
from ambient_trainer.estimators.library.free import FreeFilterEstimator
from ambient_trainer.estimators.model_file import model_of
from ambient_trainer.estimators.readings import reading_model
from ambient_trainer.estimators.registry import CircuitEstimator
from ambient_trainer.simulator.simulate import simulate
from processes import ran

SAMPLES = 12_000
"""At each period, among them 20 steps of load; errors of a recursion show within its time constants."""
PERIODS_S = (0.1, 0.2, 0.5, 1.0)
TOLERANCE_DEGC = 1e-9
MODELS = ("free-3", "model2_ss", "model2_ss_free_cd")
THRESHOLD_DEGC = 1.0
TERMS = (
    *(Term("movement", 300.0, 0.5), Term("movement", 40.0, 3.0), Term("guard", 60.0, 0.25)),
    *(Term("guard_above", 90.0, 0.5), Term("guard_below", 20.0, 0.75)),
)
CONSTANT_DEGC2 = 0.09
QUANTILES = {50: (-0.6, 0.7), 90: (-1.5, 1.8), 98: (-2.4, 2.5)}

STEPS = ((20, -10, ""), (10, -10, "cpu_100"), (30, 10, ""), (10, 30, "cpu_50"), (30, 30, ""))


@pytest.fixture(scope="module")
def trace(tmp_path_factory):
    """100 minutes of three ambients and two loads, simulated at 1 Hz."""
    scenario = tmp_path_factory.mktemp("scenario") / "short.yaml"
    steps = "".join(f"  - {{duration_min: {m}, chamber_degC: {T}, load: [{load}]}}\n" for m, T, load in STEPS)
    scenario.write_text(f"about: Short\nsteps:\n{steps}")
    return simulate(str(scenario), seed=1).trace


@pytest.fixture(scope="module")
def fits(trace):
    """Each model fitted to it, as far as a few steps lead."""
    found = {
        name: CircuitEstimator(load_circuit(name)).fit([trace], Effort(starts=1, budget=Budget(evaluations=10)))
        for name in MODELS[1:]
    }
    return {"free-3": FreeFilterEstimator(3).fit([trace], Effort(starts=1)), **found}


def read_back(model):
    """A model as a device has it: written as a file's text and read."""
    return decode(encode(model).encode(), model.name)


@pytest.fixture(scope="module")
def models(fits):
    return {name: read_back(model_of(fit, [], {})) for name, fit in fits.items()}


def _sensors(count):
    """Sensors: slow swings, steps of load, noise; (count, N) in degC."""
    random = np.random.default_rng(count)
    k = np.arange(SAMPLES)
    swing = 12 * np.sin(2 * np.pi * k / SAMPLES * random.uniform(1, 3, (count, 1)) + random.uniform(0, 6, (count, 1)))
    load = np.repeat(random.choice([0.0, 3.0, 12.0, 25.0], (count, SAMPLES // 600)), 600, axis=1)
    return 25 + swing + load + random.normal(size=(count, SAMPLES)) * 0.3


def _by_scipy(fit, u, period_s, apart=None):
    """Outputs (N,) by scipy's own first-order hold and simulation, from rest with the first sample.

    ``apart`` (n,) is by how much the device's state begins elsewhere; scipy's is int_0^T exp(A t) dt / T times that.
    """
    s = fit.system
    A, B, C, D, _ = cont2discrete((s.A, s.B, s.C, s.D), period_s, "foh")
    x0 = np.linalg.solve(np.eye(len(A)) - A, B @ u[:, 0])
    if apart is not None:
        x0 += np.linalg.solve(s.A, A - np.eye(len(A))) @ apart / period_s
    return dlsim((A, B, C, D, period_s), u.T, x0=x0)[1][:, 0] + s.offset[0]


def _by_structure(name, fit, u, period_s):
    """Outputs (N,) as the search predicts them: regressors and their coefficients."""
    structure = CircuitStructure(load_circuit(name), [Segment(period_s, u, np.zeros((1, u.shape[1])))])
    values = {each.name: each.value for each in fit.parameters}
    theta = np.array([np.log(values[each]) for each in structure.search.names])
    return structure.predicted(theta, np.array([values[each] for each in structure.linear.names]), 0)[0]


@pytest.mark.parametrize("period_s", PERIODS_S)
@pytest.mark.parametrize("name", MODELS)
def test_the_recursion(name, period_s, fits, models):
    fit, main = fits[name], models[name].main
    u = _sensors(len(fit.inputs))
    discrete = next(each for each in main.discrete if each.period_s == period_s)
    device = np.array(run_recursion(main, discrete, tuple(map(tuple, u.T.tolist()))))
    assert np.abs(device - _by_scipy(fit, u, period_s)).max() < TOLERANCE_DEGC
    if name != "free-3":
        assert np.abs(device - _by_structure(name, fit, u, period_s)).max() < TOLERANCE_DEGC


@pytest.fixture(scope="module")
def second(trace):
    """The fit of the secondary estimator: of the same sensors, of lower order."""
    return FreeFilterEstimator(1).fit([trace], Effort(starts=1))


@pytest.fixture(scope="module")
def guarded(models, second):
    """The free filter with a secondary estimator and synthetic error variance."""
    secondary = Secondary(model_of(second, [], {}).main, THRESHOLD_DEGC)
    error_variance = ErrorVariance(CONSTANT_DEGC2, TERMS, QUANTILES, Beyond(20.0, 25.0, 0.4))
    return read_back(models["free-3"]._replace(secondary=secondary, error_variance=error_variance))


def _low_pass(z, lag_s, period_s):
    kept = np.exp(-period_s / lag_s)
    return lfilter([1 - kept], [1, -kept], z - z[0]) + z[0]


def _by_equations(first, second, u, period_s):
    """Estimate, the secondary estimator's weight and sigma (N,), from the two fits by scipy alone."""
    main, guard = _by_scipy(first, u, period_s), _by_scipy(second, u, period_s)
    d = main - guard
    w = np.clip(np.abs(d) / THRESHOLD_DEGC - 1, 0, 1)
    y = main - w * d
    slow, fast = ((y - _low_pass(y, lag_s, period_s)) ** 2 for lag_s in (300.0, 40.0))
    variance = CONSTANT_DEGC2 + 0.5 * _low_pass(slow, 300.0, period_s) + 3.0 * _low_pass(fast, 40.0, period_s)
    apart = np.clip(d, -THRESHOLD_DEGC, THRESHOLD_DEGC)
    sides = 0.4 * (y - np.clip(y, 20, 25)) ** 2 + 0.5 * _low_pass(np.maximum(apart, 0) ** 2, 90.0, period_s)
    sides += 0.75 * _low_pass(np.minimum(apart, 0) ** 2, 20.0, period_s)
    return y, w, np.sqrt(variance + 0.25 * _low_pass(apart**2, 60.0, period_s) + sides)


@pytest.mark.parametrize("period_s", [0.1, 1.0])
def test_secondary_estimator_and_error_variance(period_s, fits, second, guarded, tmp_path):
    """By arrays, and by the daemon as a process."""
    both = (fits["free-3"], second)
    u = _sensors(len(fits["free-3"].inputs))
    y, w, sigma = _by_equations(*both, u, period_s)
    assert {0.0, 1.0} <= {*w.tolist()}, "it is blended in not at all at times, and alone at times"
    arrays = blended(*(_by_scipy(each, u, period_s) for each in both), THRESHOLD_DEGC)
    scale = sigma_degC(guarded.error_variance, arrays.ambient_degC, arrays.apart_degC, period_s)
    assert np.abs(arrays.ambient_degC - y).max() < TOLERANCE_DEGC
    assert np.abs(scale - sigma).max() < TOLERANCE_DEGC
    paths = [str(tmp_path / name) for name in ("model.json", "trace.csv", "out.csv")]
    save_model(paths[0], guarded)
    write_trace(paths[1], fits["free-3"].inputs, ((k * period_s, row) for k, row in enumerate(u.T.tolist())))
    ran(sys.executable, "-m", "ambientd", "replay", paths[0], paths[1], "-o", paths[2])
    said = pd.read_csv(paths[2])
    for name, values in {"ambient_degC": y, "low_degC": y - 1.5 * sigma, "high_degC": y + 1.8 * sigma}.items():
        assert np.abs(said[name] - values).max() < TOLERANCE_DEGC
    assert np.array_equal(said["status"] == "degraded", w > 0)


AWAY = 1200
HELD = 15


@pytest.fixture(scope="module")
def validated(trace, fits):
    """The free filter with its expected readings."""
    fit = fits["free-3"]
    return read_back(model_of(fit, [], {}, reading_model(fit, [trace])))


def _replaced(model, u, i):
    """u (m, N) without reading ``i`` from ``AWAY`` on, and the variance of what replaces it.

    It moves as the others and its own low-pass filters predict, which read what replaces it; then it has its
    conditional mean given the others alone, and what is left of the difference to that.
    """
    mean, P = np.array(model.mean), np.array(model.precision)
    count = len(u)
    own = np.arange(i, len(mean), count)
    others = np.setdiff1d(np.arange(len(mean)), own)
    covariance = np.linalg.inv(P[np.ix_(own, own)])
    weights = -covariance[0] @ P[np.ix_(own, others)]
    used, lows, first = u.copy(), np.tile(u[:, :1], (len(model.lags_s), 1)), AWAY + HELD
    keep = np.repeat(np.exp(-1.0 / np.array(model.lags_s)), count)[:, None]
    z, at_absence = np.array([]), np.array([])
    for k in range(1, u.shape[1]):
        lows = keep * lows + (1.0 - keep) * np.tile(used[:, k - 1 : k], (len(model.lags_s), 1))
        z = np.concatenate([u[:, k], lows[:, 0]])
        if k < AWAY:
            at_absence = np.concatenate([used[:, k], lows[:, 0]])
        elif k < first:
            z[i] = at_absence[i]
            used[i, k] = at_absence[i] - np.delete(P[i], i) @ np.delete(z - at_absence, i) / P[i, i]
        else:
            expected = mean[i] + weights @ (z - mean)[others]
            if k == first:
                apart = used[i, first - 1] - expected
            used[i, k] = expected + apart * np.exp(-(k - first + 1) / model.sensors[i].memory_s)
    return used, covariance[0, 0]


@pytest.mark.parametrize("i", [None, 1, 3])
def test_expected_readings(i, trace, fits, validated):
    fit, readings = fits["free-3"], validated.readings
    u = np.array([trace.column(each) for each in fit.inputs])
    used, variance = (u, 0.0) if i is None else _replaced(readings, u, i)
    y = _by_scipy(fit, used, 1.0, (np.array(readings.starts[0]) - validated.main.initial) @ u[:, 0])
    rows = [
        [None if j == i and k >= AWAY else value for j, value in enumerate(row)] for k, row in enumerate(u.T.tolist())
    ]
    [discrete] = [each for each in validated.main.discrete if each.period_s == 1.0]
    observer = Observer(validated, Tracker(validated.main, discrete))
    found = [observer.update(float(k), row) for k, row in enumerate(rows)]
    assert np.abs(np.array([each.used for each in found]) - used.T).max() < TOLERANCE_DEGC
    assert np.abs(np.array([each.ambient_degC for each in found]) - y).max() < TOLERANCE_DEGC
    if i is not None:
        gain = (fit.system.D - fit.system.C @ np.linalg.solve(fit.system.A, fit.system.B))[0, i]
        tail = max(readings.sensors[i].gate / (3 * np.sqrt(variance)), 1.0)
        low, high = validated.main.interval[90]
        added = 1.645**2 * (gain * tail) ** 2 * variance
        assert found[-1].status == "degraded"
        assert found[-1].low_degC == pytest.approx(y[-1] - np.sqrt(low**2 + added), abs=TOLERANCE_DEGC)
        assert found[-1].high_degC == pytest.approx(y[-1] + np.sqrt(high**2 + added), abs=TOLERANCE_DEGC)
