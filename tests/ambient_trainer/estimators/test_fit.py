"""Traces go in, a system comes out; what cannot be learned from is refused."""

from dataclasses import replace

import numpy as np
import pytest

from ambient_trainer.data.trace import Trace
from ambient_trainer.estimators.base import Effort, temperature_columns
from ambient_trainer.estimators.library import free
from ambient_trainer.estimators.library.free import FreeFilterEstimator
from ambient_trainer.estimators.registry import CircuitEstimator
from ambient_trainer.estimators.report import findings
from refusals import refused

from ..conftest import response_of, rise_inputs, truth_of

ONE = Effort(starts=1)
QUIET = slice(2500, 4600)
BY_TURNS = np.where(np.arange(7000) % 2 == 1, np.nan, np.linspace(20.0, 50.0, 7000))


@pytest.fixture
def logged(rise):
    """A trace that the rise circuit made, with 0.1 degC of white noise; at rest from 3500 to 4600 s."""

    def make(seed=0, samples=7000):
        random = np.random.default_rng(seed)
        u = rise_inputs(random, samples)
        u[:, QUIET] = u[:, [QUIET.start]]
        y = response_of(rise, u)[0] + random.normal(size=samples) * 0.1
        columns = {"board_degC": u[0], "shell_degC": u[1], "chip_degC": u[2], "ambient_degC": y}
        return Trace(f"log{seed}.csv", np.arange(samples, dtype=float), columns)

    return make


def _assert_true(fit, rise):
    """Every free parameter within 3.5 standard errors of the truth."""
    truth = truth_of(rise)
    for each in fit.parameters:
        if each.free:
            assert abs(each.value - truth[each.name]) < 3.5 * each.standard_error + 1e-6, each.name
        else:
            assert each.value == truth[each.name]


def test_a_whole_trace(rise, logged, monkeypatch):
    fit = CircuitEstimator(rise).fit([logged()], Effort(starts=2))
    _assert_true(fit, rise)
    assert (fit.converged, fit.uncertainty_available, fit.identifiable, fit.stopped) == (True, True, True, False)
    assert (fit.inputs, fit.outputs) == (("board_degC", "shell_degC", "chip_degC"), ("ambient",))
    assert (fit.states, fit.periods_s, fit.samples) == (("board", "shell"), (1.0,), 7000)
    assert fit.rmse_degC == pytest.approx(0.1, rel=0.03)
    assert fit.rmse_degC == pytest.approx(np.sqrt(np.mean(fit.errors_degC[0] ** 2)))
    assert fit.residual_memory_samples < 1.3
    assert len(fit.start_rmses_degC) == 2
    trace = logged()
    assert fit.input_ranges[2] == (30.0, 55.0)
    assert fit.input_ranges[0] == (trace.columns["board_degC"].min(), trace.columns["board_degC"].max())
    assert [each.name for each in fit.parameters] == [each.name for each in rise.parameters]
    for each in fit.parameters[2:]:
        low, high = each.interval95
        assert low < each.value < high
    # what has no interval is named where nothing is confounded
    open_ = fit.parameters[0]._replace(identifiable=False)
    told = [each.text for each in findings(replace(fit, identifiable=False, parameters=(open_,)))]
    assert f"Identifiable: no; these data do not bound {open_.name}." in told
    monkeypatch.setattr("ambient_trainer.estimators.report._LARGE_GAINS", 0.0)
    told = [findings(replace(fit, effort=Effort(pieces=each)))[-1].text for each in (1, 12)]
    assert ["--pieces 12" in each for each in told] == [True, False]


def test_holes_and_missing_samples_cost_no_accuracy(rise, logged):
    """20 s without a row, single readings missing, a reference with gaps, and a long hole in a time of rest."""
    random = np.random.default_rng(9)
    whole = logged()
    kept = np.ones(7000, dtype=bool)
    kept[1010:1030] = False
    kept[4000:4100] = False
    holed = Trace(whole.path, whole.time_s[kept], {name: values[kept] for name, values in whole.columns.items()})
    for name in ("board_degC", "shell_degC"):
        holed.columns[name] = np.where(random.uniform(size=6880) < 0.02, np.nan, holed.columns[name])
    holed.columns["ambient_degC"][random.uniform(size=6880) < 0.3] = np.nan
    full, gappy = CircuitEstimator(rise).fit([whole], ONE), CircuitEstimator(rise).fit([holed], ONE)
    _assert_true(gappy, rise)
    assert gappy.converged
    assert gappy.samples == int((~np.isnan(holed.reference)).sum())
    for one, other in zip(full.parameters, gappy.parameters):
        if one.free:
            assert abs(one.value - other.value) < 3 * other.standard_error


def test_gaps_in_transients_cost_a_filter_of_the_reference_little(rise):
    """Every other minute is missing: after a gap a device is anywhere, but not in equilibrium."""
    random, time_s = np.random.default_rng(4), np.arange(9000.0)

    def log(phase):
        u = np.array([30.0 + 8.0 * np.sin(time_s / each_s + phase) for each_s in (170.0, 290.0, 410.0)])
        u += 5.0 * np.sin(time_s / 1700.0 + np.arange(3)[:, None] * phase)
        y = response_of(rise, u)[0] + random.normal(size=len(time_s)) * 0.1
        return dict(zip(("board_degC", "shell_degC", "chip_degC", "ambient_degC"), [*u, y]))

    kept = time_s % 120.0 < 60.0
    holed = Trace("holed.csv", time_s[kept], {name: values[kept] for name, values in log(0.0).items()})
    other = Trace("other.csv", time_s, log(1.0))
    error = FreeFilterEstimator(2).fit([holed], ONE).estimate_degC(other) - other.reference
    assert np.sqrt(np.mean(error**2)) < 0.7  # 0.44; 2.6 where each stretch starts from equilibrium


def test_two_traces_tell_more_than_one_and_may_differ_in_their_periods(rise, logged):
    one, both = CircuitEstimator(rise).fit([logged(0)], ONE), CircuitEstimator(rise).fit([logged(0), logged(1)], ONE)
    _assert_true(both, rise)
    assert both.samples == 14000
    assert len(both.errors_degC[0]) == 14000
    shrunk = [b.standard_error / a.standard_error for a, b in zip(one.parameters, both.parameters) if a.free]
    assert np.mean(shrunk) == pytest.approx(np.sqrt(0.5), abs=0.15)
    fast = logged(0)
    slow = Trace("slow.csv", fast.time_s[::2], {name: values[::2] for name, values in logged(1).columns.items()})
    fit = CircuitEstimator(rise).fit([fast, slow], ONE)
    assert fit.samples == 10500
    # between the samples of the slow one the chip steps where a straight line is drawn
    for each in fit.parameters:
        truth = next(known.initial for known in rise.parameters if known.name == each.name)
        assert each.value == pytest.approx(truth, rel=0.1)


def test_a_circuit_that_predicts_its_sensors(forward):
    random = np.random.default_rng(3)
    u = np.vstack([20 + np.cumsum(random.normal(size=3000)) * 0.05, np.repeat(random.choice([0.0, 3.0, 5.0], 30), 100)])
    truth = truth_of(forward)
    y = response_of(forward, u, [30.0, 25.0, 22.0]) + random.normal(size=(3, 3000)) * 0.05
    columns = {"ambient_degC": u[0], "cpu_power_W": u[1], "a_degC": y[0], "b_degC": y[1], "c_degC": y[2]}
    fit = CircuitEstimator(forward).fit([Trace("log.csv", np.arange(3000.0), columns)], ONE)
    assert fit.outputs == ("a", "b", "c")
    assert fit.samples == 9000
    assert [len(each) for each in fit.errors_degC] == [3000] * 3
    assert fit.rmse_degC == pytest.approx(0.05, rel=0.03)
    shown = {each.name: each for each in fit.parameters}
    assert set(shown) == {name for name in truth if "." not in name}
    for name, each in shown.items():
        assert abs(each.value - truth[name]) < 3.5 * each.standard_error


def test_a_free_filter_reads_every_temperature_but_the_reference_and_has_one_to_four_states(logged):
    trace = logged()
    trace.columns["cpu_load_frac"] = np.linspace(0, 1, 7000)
    fit = FreeFilterEstimator(2).fit([trace], ONE)
    assert fit.inputs == ("board_degC", "shell_degC", "chip_degC")
    assert (fit.circuit, fit.hold, fit.states) == ("free-2", "first-order", ("mode1", "mode2"))
    assert fit.rmse_degC == pytest.approx(0.1, rel=0.03)
    assert FreeFilterEstimator(1).fit([trace], ONE, inputs=["chip_degC"]).inputs == ("chip_degC",)
    assert [free.find(name).order for name in ("free-1", "free-4")] == [1, 4]
    assert [free.find(name) for name in ("free-0", "free-5", "free-", "free-11", "xfree-1", "free-1\n")] == [None] * 6


def _with(trace, **columns):
    full = {f"{name}_degC": np.full(len(trace.time_s), values) for name, values in columns.items()}
    return replace(trace, columns={**trace.columns, **full})


@pytest.mark.parametrize(
    ("change", "facts"),
    [
        (lambda log: [replace(log(), columns={})], ["log0.csv", "'board_degC'"]),
        (
            lambda log: [_with(log(seed), board=25.5, chip=np.nan) for seed in (0, 1)],
            ["log0.csv, log1.csv", "2 faults", "column board_degC: is 25.5", "column chip_degC"],
        ),
        (lambda log: [_with(log(), ambient=20.0)], ["column ambient_degC: is 20"]),
        (lambda log: [_with(log(), ambient=np.nan)], ["column ambient_degC", "no value"]),
        (lambda log: [_with(log(), board=3e9)], ["column board_degC", "3e+09"]),
        (lambda log: [log().cut(98, 104)], ["6 samples for 6 unknowns"]),
        (lambda log: [_with(log(), board=BY_TURNS, chip=np.roll(BY_TURNS, 1))], ["board_degC, shell_degC, chip_degC"]),
    ],
)
def test_traces_that_determine_nothing_are_refused(rise, logged, change, facts):
    said = str(refused(CircuitEstimator(rise).fit, change(logged), ONE))
    assert all(fact in said for fact in facts)


def test_a_reference_may_be_constant_in_one_of_several_traces_and_is_no_sensor(rise, logged):
    calm = _with(logged(1), ambient=20.0)
    assert CircuitEstimator(rise).fit([logged(), calm], ONE).samples == 2 * len(calm.time_s)
    bare = Trace("bare.csv", np.arange(5.0), {"ambient_degC": np.arange(5.0)})
    assert "bare.csv: line 1" in str(refused(temperature_columns, [bare]))
    said = str(refused(FreeFilterEstimator(1).fit, [logged()], ONE, inputs=("board_degC", "ambient_degC")))
    assert "ambient_degC: is what is to be estimated" in said
    joined = FreeFilterEstimator(1).fit([_with(logged(), ambient_2=calm.time_s)], ONE)
    assert (joined.inputs[2:], "ambient_2_degC" in joined.notes[-1]) == (("chip_degC",), True)
