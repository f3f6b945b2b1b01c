"""The related methods: what all four do with what is missing, and that each recovers data of its own making."""

from collections.abc import Callable
from dataclasses import astuple, replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq
from scipy.signal import lsim
from sklearn.svm import SVR

from ambient_model.faults import Refused
from ambient_studies.thesis.names import RELATED
from ambient_studies.thesis.related import chau, he, ishii, li, related_estimators, related_methods
from ambient_studies.thesis.related._samples import lagged
from ambient_trainer.data.trace import Trace
from ambient_trainer.estimators.check import check_estimator

Synthetic = Callable[..., Trace]


def with_columns(trace: Trace, **columns: np.ndarray) -> Trace:
    return replace(trace, columns={**trace.columns, **columns})


def without(trace: Trace, *names: str) -> Trace:
    return replace(trace, columns={name: values for name, values in trace.columns.items() if name not in names})


def calm(trace: Trace) -> Trace:
    """A phone a little warmer than an ambient that drifts, its battery stable at times."""
    ambient = 20.0 + 8.0 * np.sin(trace.time_s / 4000.0)
    warmer = {name: ambient + 3.0 + 0.1 * (trace.columns[name] - 25.0) for name in ishii.SENSORS}
    return with_columns(trace, **{**warmer, "ambient_degC": ambient, "battery_degC": ambient + 2.0})


@pytest.fixture(scope="module")
def traces(synthetic: Synthetic) -> tuple[Trace, Trace]:
    return calm(synthetic(400, 1, 10.0)), calm(synthetic(400, 2, 10.0))


@pytest.fixture(scope="module")
def trained(traces: tuple[Trace, Trace]):
    """Each with the columns that it reads."""
    return list(zip(related_methods(*traces), [each.inputs for each in related_estimators()]))


def test_each_follows_the_ambient_and_is_the_same_each_time(trained, traces, synthetic: Synthetic) -> None:
    assert [method.name for method, _ in trained] == list(RELATED)
    unseen = calm(synthetic(1000, 5, 10.0))
    for (method, _), again in zip(trained, related_methods(*traces)):
        error = method.estimate(unseen) - unseen.reference
        assert np.sqrt(np.mean(error**2)) < 0.5 * unseen.reference.std(), method.name
        assert method.estimate(unseen).tobytes() == again.estimate(unseen).tobytes(), method.name


def test_a_missing_value_leaves_that_sample_without_an_estimate(trained, synthetic: Synthetic) -> None:
    trace = calm(synthetic(500, seed=5))
    for method, columns in trained:
        whole = method.estimate(trace)
        for column in trace.columns:
            values = trace.columns[column].copy()
            values[[0, 77]] = np.nan
            found = method.estimate(with_columns(trace, **{column: values}))
            assert np.flatnonzero(np.isnan(found)).tolist() == ([0, 77] if column in columns else []), column
            # later samples change by a little at most: the gap is bridged by a straight line
            assert np.abs(found - whole)[200:].max() < 0.05, column
        empty = with_columns(trace, **{columns[0]: np.full(500, np.nan)})
        assert np.isnan(method.estimate(empty)).all(), method.name


def test_missing_columns_are_refused_in_one_message(trained, traces, synthetic: Synthetic) -> None:
    for method, columns in trained:
        with pytest.raises(Refused) as refused:
            method.estimate(without(synthetic(50, seed=5), *columns))
        assert [fault.problem for fault in refused.value.faults] == [f"no column '{name}'" for name in columns]
    training, idle = traces
    for lacking in ((without(training, "display_degC"), idle), (training, without(idle, "cpu_load_frac"))):
        with pytest.raises(Refused, match="no column"):
            related_methods(*lacking)


def test_training_samples_with_gaps_are_left_out(traces, synthetic: Synthetic) -> None:
    training, idle = traces
    for offset, (column, values) in enumerate(training.columns.items()):
        holed = values.copy()
        holed[offset::29] = np.nan
        training = with_columns(training, **{column: holed})
    for method in related_methods(training, idle):
        assert np.isfinite(method.estimate(calm(synthetic(300, seed=7)))).all(), method.name


def test_each_keeps_the_contract_of_estimators(traces, synthetic: Synthetic) -> None:
    for each in related_estimators():
        fit = check_estimator(each, [traces[0]], calm(synthetic(300, seed=7)))
        assert fit.discrete(1.0) is None


# the first-order response


@pytest.mark.parametrize("tau_s", [0.7, 900.0])
@pytest.mark.parametrize("spacing", ["even", "uneven"])
def test_the_response_is_that_of_the_differential_equation(tau_s: float, spacing: str) -> None:
    rng = np.random.default_rng(3)
    steps_s = np.ones(60) if spacing == "even" else rng.uniform(0.2, 3.0, 60)
    time_s = np.concatenate([[5.0], 5.0 + np.cumsum(steps_s)])
    values = 20.0 + np.cumsum(rng.normal(0.0, 1.0, 61))

    def slope(t: float, x: np.ndarray) -> np.ndarray:
        return (np.interp(t, time_s, values) - x) / tau_s

    expected = [values[0]]
    for start, stop in pairwise(time_s):  # the input has a kink at every sample
        expected.append(solve_ivp(slope, (start, stop), expected[-1:], rtol=1e-11, atol=1e-11).y[0, -1])
    assert lagged(time_s, values, tau_s) == pytest.approx(np.array(expected), abs=1e-8)


def test_the_response_starts_again_after_a_gap_too_long_to_bridge() -> None:
    time_s = np.concatenate([np.arange(50.0), [79.0], 110.0 + np.arange(5.0)])
    values = np.linspace(0.0, 10.0, 56)
    found = lagged(time_s, values, 20.0)
    assert found[0] == values[0]
    assert found[50] != values[50], "30 s are bridged"
    assert found[51] == values[51], "31 s are not"


# Chau


def idle_phone(seed: int, slope: float = 0.9, offset: float = -1.5) -> Trace:
    """An hour idle, drifting slowly enough to count as stable; 20 min busy, 20 K warmer; 10 min of cooling, idle."""
    rng = np.random.default_rng(seed)
    time_s = np.arange(5400.0)
    idle = 15.0 + 10.0 * np.sin(time_s / 20000.0 + seed)
    busy = (time_s >= 3600.0) & (time_s < 4800.0)
    columns = {
        "battery_degC": idle + 20.0 * np.where(busy, 1.0, np.exp(-(time_s - 4800.0) / 400.0) * (time_s >= 4800.0)),
        "cpu_load_frac": np.where(busy, 0.2, 0.03),
        "charging_on": np.zeros(5400),
        "ambient_degC": slope * idle + offset + rng.normal(0.0, 0.2, 5400),
    }
    return Trace(f"idle phone {seed}", time_s, columns)


def test_chaus_line_is_recovered_from_idle_samples_and_applied_to_all() -> None:
    traces = [idle_phone(1), idle_phone(3)]
    fit = chau.ESTIMATOR.fit(traces)
    line = fit.predictor
    fitted = np.concatenate([trace.columns["battery_degC"][300:3600] for trace in traces])
    assert line.slope == pytest.approx(0.9, abs=4 * 0.2 / np.sqrt(len(fitted)) / fitted.std())
    assert line.slope * fitted.mean() + line.offset_degC == pytest.approx(0.9 * fitted.mean() - 1.5, abs=0.02)
    assert chau.train([idle_phone(1, slope=0.5, offset=2.0)]).slope == pytest.approx(0.5, abs=0.05)
    battery = traces[0].columns["battery_degC"]
    assert np.array_equal(fit.estimate_degC(traces[0]), line.slope * battery + line.offset_degC)


def test_chaus_battery_is_stable_when_it_is_where_it_was_five_minutes_before_and_idle_since() -> None:
    time_s = np.arange(0.0, 1200.0, 10.0)
    stepping = chau.stable(time_s, np.where(time_s < 600.0, 20.0, 21.0), np.ones(120, dtype=bool))
    assert np.array_equal(stepping, ((time_s >= 300.0) & (time_s < 600.0)) | (time_s >= 900.0))
    worked = chau.stable(time_s, np.full(120, 35.0), (time_s < 400.0) | (time_s > 600.0))
    assert np.array_equal(worked, ((time_s >= 300.0) & (time_s < 400.0)) | (time_s > 900.0))


@pytest.mark.parametrize("column", ["cpu_load_frac", "charging_on"])
def test_a_busy_phone_is_refused_by_chau(column: str) -> None:
    with pytest.raises(Refused, match="0 samples of an idle phone"):
        chau.train([with_columns(idle_phone(1), **{column: np.ones(5400)})])


# He


def quadratic(trace: Trace, noise: float = 0.0) -> Trace:
    T, I = trace.columns["battery_degC"], -trace.columns["battery_current_A"]  # noqa: E741
    ambient = 1.0 + 0.9 * T - 4.0 * I + 0.003 * T**2 - 0.05 * T * I + 0.8 * I**2
    random = np.random.default_rng(9).standard_normal(len(T))
    return with_columns(trace, ambient_degC=ambient + noise * random)


def test_hes_regression_recovers_a_quadratic_and_is_the_expansion_over_its_support_vectors(synthetic) -> None:
    training, unseen = quadratic(synthetic(600, seed=1), noise=0.1), quadratic(synthetic(3000, seed=2))
    regression = he.ESTIMATOR.fit([training])
    found = regression.estimate_degC(unseen)
    assert np.sqrt(np.mean((found - unseen.reference) ** 2)) < 0.1
    svr = regression.predictor.pipeline["svr"]
    x = np.column_stack([training.columns["battery_degC"], -training.columns["battery_current_A"]])
    fitted = x[np.linspace(0, 599, 600).round().astype(int)]
    z = (x - fitted.mean(axis=0)) / fitted.std(axis=0)
    expansion = svr.dual_coef_[0] @ (1.0 + svr.support_vectors_ @ z.T) ** 2 + svr.intercept_
    assert regression.estimate_degC(training) == pytest.approx(expansion, abs=1e-8)
    # a charging battery discharges nothing
    charged, idle, used = (
        regression.estimate_degC(with_columns(unseen, battery_current_A=np.full(3000, current)))
        for current in (3.0, 0.0, -3.0)
    )
    assert np.array_equal(charged, idle)
    assert not np.array_equal(used, idle)


def test_hes_selection_is_that_of_contiguous_blocks() -> None:
    """Every C and epsilon, scored by hand on fifths that the fit did not see; the relation drifts over the trace."""
    rng = np.random.default_rng(6)
    time_s = np.arange(100.0)
    battery, current = 25.0 + 6.0 * np.sin(time_s / 15.0), -np.abs(np.sin(time_s / 4.0))
    ambient = battery + 5.0 * current + 6.0 * np.sin(time_s / 11.0) + rng.normal(0.0, 0.3, 100)
    columns = {"battery_degC": battery, "battery_current_A": current, "ambient_degC": ambient}
    x = np.column_stack([battery, -current])
    scores = {}
    for C in (0.1, 1.0, 10.0, 100.0):
        for epsilon in (0.1, 0.3, 1.0, 3.0):
            errors = []
            for block in np.array_split(np.arange(100), 5):
                rest = np.setdiff1d(np.arange(100), block)
                mean, std = x[rest].mean(axis=0), x[rest].std(axis=0)
                svr = SVR(kernel="poly", degree=2, gamma=1.0, coef0=1.0, C=C, epsilon=epsilon, tol=0.01)
                svr.fit((x[rest] - mean) / std, ambient[rest])
                errors.append(ambient[block] - svr.predict((x[block] - mean) / std))
            scores[C, epsilon] = np.mean([np.sqrt(np.mean(error**2)) for error in errors])
    svr = he.train([Trace("drifting", time_s, columns)]).pipeline["svr"]
    assert (svr.C, svr.epsilon) == min(scores, key=scores.__getitem__)


def test_too_few_samples_are_refused_by_he(synthetic: Synthetic) -> None:
    trace = synthetic(400, seed=1)
    with pytest.raises(Refused, match=r"9 samples hold .*the least is 10"):
        he.train([with_columns(trace, ambient_degC=np.where(np.arange(400) < 9, trace.reference, np.nan))])


# Ishii and Nakashima

GAIN = np.array([1.0, -0.1, -0.2, -0.3, -0.15])
ZERO_S = np.array([200.0, 60.0, 10.0, 100.0, 150.0])
POLE_S = np.array([40.0, 120.0, 50.0, 400.0, 30.0])


def through_transfer_functions(trace: Trace, separation: np.ndarray, noise: float = 0.0) -> Trace:
    """The ambient behind K (1 + tau1 s)/(1 + tau2 s) of every source, by scipy's simulation."""
    ambient = -0.5 + noise * np.random.default_rng(4).standard_normal(len(trace.time_s))
    rows = np.vstack([trace.columns[name] for name in ishii.SENSORS])
    for source, K, tau1, tau2 in zip(separation @ rows, GAIN, ZERO_S, POLE_S):
        _, response, _ = lsim(([K * tau1, K], [tau2, 1.0]), source - source[0], trace.time_s)
        ambient += K * source[0] + response
    return with_columns(trace, ambient_degC=ambient)


def test_ishiis_transfer_functions_are_recovered(synthetic: Synthetic) -> None:
    trace = synthetic(5000, seed=1)
    separation = ishii.separated(trace)
    fit = ishii.ESTIMATOR.fit([through_transfer_functions(trace, separation, noise=0.1)])
    found = fit.predictor
    assert np.array_equal(found.separation, separation)
    assert found.time_constant_s == pytest.approx(POLE_S, rel=0.1)
    assert found.gain == pytest.approx(GAIN, abs=0.01)
    assert found.direct * found.time_constant_s / found.gain == pytest.approx(ZERO_S, rel=0.1, abs=2.0)
    assert found.offset_degC == pytest.approx(-0.5, abs=0.1)
    unseen = through_transfer_functions(synthetic(3000, seed=2), separation)
    assert np.sqrt(np.mean((fit.estimate_degC(unseen) - unseen.reference) ** 2)) < 0.03


def test_ishiis_sources_are_what_no_stronger_source_explains(synthetic: Synthetic) -> None:
    trace = synthetic(3000, seed=1)
    usb, *others = rows = np.vstack([trace.columns[name] for name in ishii.SENSORS])
    reference, *sources = ishii.separated(trace) @ rows
    assert np.array_equal(reference, usb)
    for index, (sensor, source) in enumerate(zip(others, sources)):
        expected = sensor - usb
        if index:
            stronger = np.array(sources[:index])
            expected = expected - np.linalg.lstsq(stronger.T, expected, rcond=None)[0] @ stronger
        assert source == pytest.approx(expected, abs=1e-8)
    with pytest.raises(Refused, match="not independent"):
        ishii.train([with_columns(trace, flash_degC=usb)])


# Li

TRUTH = li.Surface(
    usb_share=0.4, battery=0.8, flash=0.3, soc=0.03, own_heat_K=0.4, storage_s=500.0, convection=0.6, lag_s=5.0
)


@given(
    surface=st.floats(-60.0, 120.0),
    heat=st.floats(-500.0, 500.0) | st.sampled_from([0.0, 1e-300, -1e-12]),
    convection=st.floats(0.0, 1000.0),
)
def test_lis_fixed_point_is_the_root(surface: float, heat: float, convection: float) -> None:
    def balance(y: float) -> float:
        return (1.0 + convection * abs(y) ** 0.25) * y - heat

    # the neighbour is another sample: none depends on another
    found = li.fixed_point(np.array([surface, 20.0]), np.array([heat, 5.0]), convection)
    reach = abs(heat) + 1.0
    assert found[0] == pytest.approx(surface - brentq(balance, -reach, reach, xtol=1e-13), abs=1e-9)
    assert found[0] == li.fixed_point(np.array([surface]), np.array([heat]), convection)[0]


def test_what_does_not_settle_is_no_number() -> None:
    # a loss that falls with the difference is no circuit, and the iteration wanders
    found = li.fixed_point(np.array([20.0, 20.0]), np.array([5.0, 0.0]), -0.5)
    assert np.isnan(found[0])
    assert found[1] == 20.0


def on_the_circuit(seed: int, samples: int = 8000, period_s: float = 2.0) -> Trace:
    """Sensors whose surface obeys the circuit with the parameters TRUTH, its lag apart, read to 0.002 degC."""
    rng = np.random.default_rng(seed)
    time_s = np.arange(samples) * period_s
    knots_s = np.linspace(0.0, time_s[-1], 30)
    ambient, battery, flash, soc, tilt = (
        CubicSpline(knots_s, level + reach * rng.uniform(-1.0, 1.0, 30))
        for level, reach in [(15.0, 15.0), (25.0, 12.0), (30.0, 15.0), (50.0, 30.0), (0.0, 2.0)]
    )

    def slope(t: float, surface: np.ndarray) -> np.ndarray:
        shares = [(TRUTH.battery, battery), (TRUTH.flash, flash), (TRUTH.soc, soc)]
        arriving = sum(share * (hot(t) - surface) for share, hot in shares)
        y = surface - ambient(t)
        return (TRUTH.own_heat_K + arriving - (1.0 + TRUTH.convection * np.abs(y) ** 0.25) * y) / TRUTH.storage_s

    surface = solve_ivp(slope, (0.0, time_s[-1]), [20.0], t_eval=time_s, rtol=1e-8, atol=1e-8).y[0]
    true = {
        "usb_degC": surface + (1.0 - TRUTH.usb_share) * tilt(time_s),
        "display_degC": surface - TRUTH.usb_share * tilt(time_s),
        "battery_degC": battery(time_s),
        "flash_degC": flash(time_s),
        "soc_degC": soc(time_s),
    }
    read = {name: values + rng.normal(0.0, 0.002, samples) for name, values in true.items()}
    return Trace(f"circuit {seed}", time_s, {**read, "ambient_degC": ambient(time_s)})


def test_lis_circuit_is_recovered() -> None:
    fit = li.ESTIMATOR.fit([on_the_circuit(1)])
    found = fit.predictor
    # the derivative's lag, at least 5 s, makes the little that is missing
    assert astuple(found)[:4] == pytest.approx(astuple(TRUTH)[:4], rel=0.05, abs=0.003)
    assert found.own_heat_K == pytest.approx(TRUTH.own_heat_K, abs=0.2)
    assert found.storage_s == pytest.approx(TRUTH.storage_s, rel=0.05)
    assert found.convection == pytest.approx(TRUTH.convection, rel=0.1)
    unseen = on_the_circuit(2)
    assert np.sqrt(np.mean((fit.estimate_degC(unseen) - unseen.reference)[60:] ** 2)) < 0.15


def test_at_steady_state_lis_ambient_is_the_root_of_the_balance() -> None:
    rows = np.repeat([[30.0], [32.0], [36.0], [40.0], [60.0]], 50, axis=1)
    found = TRUTH.ambient_degC(np.arange(50.0), rows)
    surface = 0.4 * 30.0 + 0.6 * 32.0
    heat = 0.4 + 0.8 * (36.0 - surface) + 0.3 * (40.0 - surface) + 0.03 * (60.0 - surface)
    rise = brentq(lambda y: (1.0 + 0.6 * y**0.25) * y - heat, 0.0, 50.0, xtol=1e-13)
    assert found == pytest.approx(np.full(50, surface - rise), abs=1e-8)
