"""An evaluation against a recursion written out in numpy, what it counts and refuses, and the command from outside."""

from dataclasses import replace

import numpy as np
import pytest

from ambient_model.model import Model
from ambient_trainer.data.trace import Trace, load_trace, save_trace, sha256_of
from ambient_trainer.estimation.error_variance import sigma_degC
from ambient_trainer.estimators.estimate import blended, estimate_degC
from ambient_trainer.evaluation.evaluate import evaluate_cold, evaluate_trace
from ambient_trainer.evaluation.report import report_of
from ambient_trainer.lti.statespace import StateSpace
from refusals import refused

from ..conftest import run_loop
from .conftest import BASELINE, guarded_model, sensor_trace, two_sensor_model

INPUTS = ("usb_degC", "battery_degC")
SYSTEM = StateSpace(
    A=np.array([[-0.02, 0.01], [0.001, -0.003]]),
    B=np.array([[0.01, 0.0], [0.0, 0.002]]),
    C=np.array([[-0.4, 0.9]]),
    D=np.array([[0.3, 0.2]]),
    offset=np.array([-1.5]),
)


@pytest.mark.parametrize("period_s", [0.1, 1.0, 10.0])
def test_missing_values_and_gaps_leave_what_came_before_and_are_bridged(period_s):
    """By the device's own tracker; without them it is the array's recursion, which the parity tests hold against it."""
    whole = sensor_trace(600, period_s=period_s)
    usb = whole.columns["usb_degC"].copy()
    usb[[50, 51, 200]] = np.nan
    usb[300:360] = np.nan
    holes = replace(whole, columns={**whole.columns, "usb_degC": usb})
    kept = np.delete(np.arange(600), [100, 101, *range(400, 480)])
    gaps = replace(holes, time_s=holes.time_s[kept], columns={k: v[kept] for k, v in holes.columns.items()})
    expected = estimate_degC(SYSTEM, "first-order", INPUTS, whole)
    for each in (holes, gaps):
        found = estimate_degC(SYSTEM, "first-order", INPUTS, each)
        np.testing.assert_allclose(found[:50], expected[:50], rtol=0, atol=1e-9)
        assert np.isfinite(found[50:100]).all()
        assert np.abs(found[52:100] - expected[52:100]).max() < 1.0
    usb[0] = np.nan
    assert np.isnan(estimate_degC(SYSTEM, "first-order", INPUTS, holes)[0])


def test_an_unstable_system_ends_in_no_estimate():
    """One mode grows by e in two seconds; a decoupled one and the samples before it diverges are untouched."""
    growing = replace(SYSTEM, A=np.diag([0.5, -0.01]), C=np.array([[1.0, 0.5]]))
    found = estimate_degC(growing, "first-order", INPUTS, sensor_trace(4000))
    first = int(np.argmin(np.isfinite(found)))
    assert 20 < first < 100
    assert np.isnan(found[first:]).all()


def recursed(model: Model, trace: Trace, which: int) -> np.ndarray:
    """x[k+1] = A x + B u, y = C x + D u + offset, from X0 u[0]."""
    A, B, C, D = (np.array(each) for each in model.main.discrete[which][1:])
    u = np.vstack([trace.columns[name] for name in INPUTS])
    return run_loop(StateSpace(A, B, C, D, np.array([model.main.offset])), u, np.array(model.main.initial) @ u[:, 0])[0]


def without(trace: Trace, column: str, *indices: int) -> Trace:
    holed = trace.columns[column].copy()
    holed[list(indices)] = np.nan
    return replace(trace, columns={**trace.columns, column: holed})


def test_a_guarded_model_is_scored_as_it_is_published():
    """Against the rules over arrays, which their own tests hold against the device's."""
    model, trace = guarded_model(), sensor_trace(2000)
    found = evaluate_trace(model, trace)
    both = (recursed(model._replace(main=each), trace, 0) for each in (model.main, model.secondary.estimator))
    said = blended(*both, 1.5)
    scale = sigma_degC(model.error_variance, said.ambient_degC, said.apart_degC, 1.0)
    assert found.estimate_degC == pytest.approx(said.ambient_degC, abs=1e-9)
    assert found.low_degC == pytest.approx(said.ambient_degC - 1.5 * scale, abs=1e-9)
    assert found.high_degC == pytest.approx(said.ambient_degC + 1.8 * scale, abs=1e-9)
    assert np.array_equal(found.status == "degraded", said.weight > 0)
    assert set(found.status) == {"warming_up", "tracking", "degraded"}
    error = trace.reference - said.ambient_degC
    assert found.coverage == {
        level: np.mean((error >= low * scale) & (error <= high * scale))
        for level, (low, high) in ((50, (-0.6, 0.7)), (90, (-1.5, 1.8)), (98, (-2.4, 2.5)))
    }
    inside = (trace.reference >= found.low_degC) & (trace.reference <= found.high_degC)
    assert found.coverage == {**found.published_coverage, 90: np.mean(inside)}


def test_the_recursion_runs_at_the_period_nearest_the_traces():
    model, trace = two_sensor_model(periods_s=(0.1, 1.0, 10.0)), sensor_trace(300, period_s=10.0)
    found = evaluate_trace(model, trace)
    assert (found.period_s, found.trace_period_s) == (10.0, 10.0)
    assert found.estimate_degC == pytest.approx(recursed(model, trace, 2), abs=1e-9)


def test_what_is_not_scored_is_counted():
    trace = without(without(sensor_trace(200), "usb_degC", 0, 1, 2, 50), "ambient_degC", 2, 100, 101)
    found = evaluate_trace(two_sensor_model(), trace)
    # at 50 the last reading stands in, and sample 2 lacks both
    assert (found.without_estimate, found.without_reference) == (3, 2)
    assert found.scored == 195
    assert found.status[[0, 1, 2, 3, 50]].tolist() == ["faulted"] * 3 + ["warming_up", "coasting"]
    assert np.flatnonzero(np.isnan(found.error_degC)).tolist() == [0, 1, 2, 100, 101]
    kept = np.isfinite(found.error_degC)
    assert found.metrics.mae_degC == pytest.approx(np.abs(found.error_degC[kept]).mean())


def test_the_baseline_is_scored_on_the_same_samples():
    trace = without(without(sensor_trace(200), "battery_degC", 0, 60), "ambient_degC", 100)
    found = evaluate_trace(two_sensor_model({"baseline": BASELINE}), trace)
    usb, battery = trace.columns["usb_degC"], trace.columns["battery_degC"].copy()
    battery[60] = battery[59]  # held, as the model's own input is
    error = (trace.reference - (1.25 * usb - 0.3 * battery + 0.5))[[k for k in range(200) if k not in (0, 100)]]
    assert found.baseline.metrics.samples == found.scored == 198
    assert found.baseline.metrics.rmse_degC == pytest.approx(np.sqrt(np.mean(error**2)), abs=1e-9)
    assert found.baseline.metrics.mbe_degC == pytest.approx(error.mean(), abs=1e-9)


@pytest.mark.parametrize(
    ("provenance", "change", "facts"),
    [
        ({"gains": {"usb": 1.0, "skin": 0.1}}, {}, ("provenance.baseline.gains", "skin", "usb, battery")),
        ({"gains": {"usb": "much"}}, {}, ("model two sensors: provenance.baseline.gains.usb",)),
        ({}, {"battery_degC": None, "ambient_degC": None}, ("line 1", "'battery_degC', 'ambient_degC'")),
        ({}, {"usb_degC": 500.0}, ("50 samples", "0 have an estimate", "50 a reference", "0 both")),
    ],
)
def test_what_cannot_be_scored_is_refused(provenance, change, facts):
    trace = sensor_trace(50)
    moved = {name: values + (change.get(name) or 0.0) for name, values in trace.columns.items()}
    columns = {name: values for name, values in moved.items() if change.get(name, 0.0) is not None}
    model = two_sensor_model({"baseline": {**BASELINE, **provenance}})
    said = str(refused(evaluate_trace, model, replace(trace, columns=columns)))
    assert all(fact in said for fact in facts)


@pytest.mark.parametrize(
    ("trained", "evaluated", "overlaps"),
    [
        ((None, None), (None, None), True),
        ((None, 60.0), (60.0, None), False),  # half open: sample 60 was not trained on
        ((None, 60.5), (60.0, None), True),
        ((60.0, None), (None, 60.0), False),
        ((60.0, None), (None, 61.0), True),
        ((20.0, 30.0), (10.0, 40.0), True),
        ((20.25, 20.75), (None, None), False),  # no sample lies between
        ((500.0, None), (None, None), False),
    ],
)
def test_training_samples_are_recognised(tmp_path, trained, evaluated, overlaps):
    path = str(tmp_path / "renamed.csv")
    save_trace(path, sensor_trace(100))
    span = {"trace": "original.csv", "sha256": sha256_of(path), "from_s": trained[0], "to_s": trained[1]}
    found = evaluate_cold(two_sensor_model({"training": [span]}), load_trace(path), *evaluated)
    assert found.overlaps_training is overlaps


def test_the_terminal_shows_the_figures_of_the_json(files, figures):
    whole = sensor_trace(1200)
    whole.columns["usb_degC"][:7] = 95.0  # above the input's range
    model, trace = files(whole, {"baseline": BASELINE})
    found, printed = figures("evaluate", model, trace)
    (only,) = found["traces"]
    assert (only["samples"], only["unscored"], only["overlaps_training"]) == (1193, 7, False)
    for each in (only, only["baseline"]):
        assert list(each["interval_degC"]) == ["50", "90", "98"]
        assert all(low < each["mbe_degC"] < high for low, high in each["interval_degC"].values())
    lines = [line.split() for line in printed.splitlines() if "trace.csv" in line]
    rmse = [f"{each['rmse_degC']:.2f}" for each in (only, only["baseline"])]
    assert [rmse[k] in line and "1,193" in line for k, line in enumerate(lines)] == [True, True]
    title, *findings = printed.splitlines()
    assert rmse[0] in title
    assert "1,193" in title
    assert any(rmse[1] in line for line in findings)
    assert f"{100 * only['coverage']['90']:.1f} %" in printed
    assert "7 more samples have no estimate" in printed


@pytest.mark.parametrize(("apart_degC", "status"), [(1.0, "warning"), (-1.0, "plain")])
def test_an_interval_that_is_too_narrow_as_it_was_published_is_a_warning(apart_degC, status):
    model = two_sensor_model({})
    found = evaluate_trace(model, sensor_trace(500))
    found = replace(found, low_degC=found.reference_degC + apart_degC, high_degC=found.reference_degC + 2.0)
    stated = [each for each in report_of(model, [found]).lead if "90 %" in getattr(each, "text", "")]
    assert [each.status for each in stated] == [status]


def test_figures_on_training_data_are_called_so(files, figures, tmp_path):
    _, trace = files(sensor_trace(120))
    training = {"trace": "t", "sha256": sha256_of(trace), "from_s": None, "to_s": 50}
    model, trace = files(sensor_trace(120), {"training": [training]})
    found, printed = figures("evaluate", model, trace, "--report", tmp_path / "report")
    assert found["traces"][0]["overlaps_training"] is True
    assert "trace.csv (training data)" in printed
    for shown in (printed, (tmp_path / "report" / "index.html").read_text()):
        assert "Not held out: the model was trained on samples of trace.csv" in shown
