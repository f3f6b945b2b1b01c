"""The related methods: what all four do with what is missing, and that each recovers data of its own making."""

from dataclasses import astuple, replace
from functools import partial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq
from scipy.signal import lsim

from ambient_studies.thesis.published import RELATED
from ambient_studies.thesis.related import chau, he, ishii, li, related, related_methods
from ambient_studies.thesis.related._samples import estimated
from ambient_trainer.data.grid import Segment
from ambient_trainer.data.trace import Trace
from refusals import refused

from .conftest import wandering


def with_columns(trace: Trace, **columns: np.ndarray) -> Trace:
    return replace(trace, columns={**trace.columns, **columns})


def calm(trace: Trace) -> Trace:
    """A phone a little warmer than an ambient that drifts, its battery stable at times."""
    ambient = 20.0 + 8.0 * np.sin(trace.time_s / 4000.0)
    warmer = {name: ambient + 3.0 + 0.1 * (trace.columns[name] - 25.0) for name in ishii.SENSORS}
    return with_columns(trace, **{**warmer, "ambient_degC": ambient, "battery_degC": ambient + 2.0})


@pytest.fixture(scope="module")
def traces() -> tuple[Trace, Trace]:
    return calm(wandering(400, 1, 10.0)), calm(wandering(400, 2, 10.0))


@pytest.fixture(scope="module")
def trained(traces: tuple[Trace, Trace]):
    """Each with the columns that it reads."""
    return list(zip(related_methods(*traces), [each.inputs for each in related()]))


def test_each_follows_the_ambient_and_is_the_same_each_time(trained, traces) -> None:
    assert [method.name for method, _ in trained] == list(RELATED)
    unseen = calm(wandering(1000, 5, 10.0))
    for (method, _), again in zip(trained, related_methods(*traces)):
        error = method.estimate(unseen) - unseen.reference
        assert np.sqrt(np.mean(error**2)) < 0.5 * unseen.reference.std(), method.name
        assert method.estimate(unseen).tobytes() == again.estimate(unseen).tobytes(), method.name


def test_a_missing_value_leaves_that_sample_without_an_estimate(trained) -> None:
    trace = calm(wandering(500, seed=5))
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
    line = chau.train(*traces)
    fitted = np.concatenate([trace.columns["battery_degC"][300:3600] for trace in traces])
    assert line.slope == pytest.approx(0.9, abs=4 * 0.2 / np.sqrt(len(fitted)) / fitted.std())
    assert line.slope * fitted.mean() + line.offset_degC == pytest.approx(0.9 * fitted.mean() - 1.5, abs=0.02)
    assert chau.train(idle_phone(1, slope=0.5, offset=2.0)).slope == pytest.approx(0.5, abs=0.05)
    battery = traces[0].columns["battery_degC"]
    assert np.array_equal(chau.METHOD.trained(*traces)(traces[0]), line.slope * battery + line.offset_degC)


def quadratic(trace: Trace, noise: float = 0.0) -> Trace:
    T, I = trace.columns["battery_degC"], -trace.columns["battery_current_A"]  # noqa: E741
    ambient = 1.0 + 0.9 * T - 4.0 * I + 0.003 * T**2 - 0.05 * T * I + 0.8 * I**2
    random = np.random.default_rng(9).standard_normal(len(T))
    return with_columns(trace, ambient_degC=ambient + noise * random)


def test_hes_regression_recovers_a_quadratic_and_is_the_expansion_over_its_support_vectors() -> None:
    training, unseen = quadratic(wandering(600, seed=1), noise=0.1), quadratic(wandering(3000, seed=2))
    regression = he.train(training)
    estimate = partial(estimated, columns=he.SENSORS, estimate=regression.ambient_degC)
    assert np.sqrt(np.mean((estimate(unseen) - unseen.reference) ** 2)) < 0.1
    svr = regression.pipeline["svr"]
    x = np.column_stack([training.columns["battery_degC"], -training.columns["battery_current_A"]])
    fitted = x[np.linspace(0, 599, 600).round().astype(int)]
    z = (x - fitted.mean(axis=0)) / fitted.std(axis=0)
    expansion = svr.dual_coef_[0] @ (1.0 + svr.support_vectors_ @ z.T) ** 2 + svr.intercept_
    assert estimate(training) == pytest.approx(expansion, abs=1e-8)
    # a charging battery discharges nothing
    charged, idle, used = (
        estimate(with_columns(unseen, battery_current_A=np.full(3000, current))) for current in (3.0, 0.0, -3.0)
    )
    assert np.array_equal(charged, idle)
    assert not np.array_equal(used, idle)


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


def test_ishiis_transfer_functions_are_recovered() -> None:
    trace = wandering(5000, seed=1)
    separation = ishii.separated(trace)
    found = ishii.train(through_transfer_functions(trace, separation, noise=0.1))
    assert np.array_equal(found.separation, separation)
    assert found.time_constant_s == pytest.approx(POLE_S, rel=0.1)
    assert found.gain == pytest.approx(GAIN, abs=0.01)
    assert found.direct * found.time_constant_s / found.gain == pytest.approx(ZERO_S, rel=0.1, abs=2.0)
    assert found.offset_degC == pytest.approx(-0.5, abs=0.1)
    unseen = through_transfer_functions(wandering(3000, seed=2), separation)
    assert np.sqrt(np.mean((estimated(unseen, ishii.SENSORS, found.ambient_degC) - unseen.reference) ** 2)) < 0.03


def test_ishiis_sources_are_what_no_stronger_source_explains() -> None:
    trace = wandering(3000, seed=1)
    usb, *others = rows = np.vstack([trace.columns[name] for name in ishii.SENSORS])
    reference, *sources = ishii.separated(trace) @ rows
    assert np.array_equal(reference, usb)
    for index, (sensor, source) in enumerate(zip(others, sources)):
        expected = sensor - usb
        if index:
            stronger = np.array(sources[:index])
            expected = expected - np.linalg.lstsq(stronger.T, expected, rcond=None)[0] @ stronger
        assert source == pytest.approx(expected, abs=1e-8)
    assert "not independent" in str(refused(ishii.train, with_columns(trace, flash_degC=usb)))


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
    found = li.train(on_the_circuit(1))
    # the derivative's lag, at least 5 s, makes the little that is missing
    assert astuple(found)[:4] == pytest.approx(astuple(TRUTH)[:4], rel=0.05, abs=0.003)
    assert found.own_heat_K == pytest.approx(TRUTH.own_heat_K, abs=0.2)
    assert found.storage_s == pytest.approx(TRUTH.storage_s, rel=0.05)
    assert found.convection == pytest.approx(TRUTH.convection, rel=0.1)
    unseen = on_the_circuit(2)
    error = estimated(unseen, li.SENSORS, found.ambient_degC) - unseen.reference
    assert np.sqrt(np.mean(error[60:] ** 2)) < 0.15


def test_the_slopes_of_ratios_are_derivatives() -> None:
    """That the outputs are what they are called is seen where transfer functions are recovered."""
    inputs = np.vstack([wandering(300, 1).columns[name] for name in ("usb_degC", "battery_degC")])
    structure = ishii.FirstOrderRatios([Segment(2.0, inputs, np.zeros((1, 300)))], (1, -1))
    theta, beta, step = np.log([30.0, 40.0]), np.array([0.7, -0.2, 1.1, -0.4, 5.0]), 1e-5
    for slope, move in zip(structure.slopes(theta, beta, 0), step * np.eye(2)):
        around = (structure.predicted(theta + each, beta, 0) for each in (move, -move))
        assert slope == pytest.approx(np.subtract(*around) / (2 * step), rel=1e-6, abs=1e-6)
