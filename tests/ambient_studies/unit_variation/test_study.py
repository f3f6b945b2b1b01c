"""Units' runs, the study against its own pieces put together by hand, and the command."""

from dataclasses import replace

import numpy as np
import pytest

from ambient_model.model import Model
from ambient_studies.unit_variation.study import CALIBRATION, LIE_DEGC, Plan, offsets_by_day, run_of, study
from ambient_trainer.data import Trace
from ambient_trainer.estimators.base import Effort
from ambient_trainer.estimators.model_file import model_of
from ambient_trainer.estimators.registry import estimator
from ambient_trainer.evaluation.evaluate import evaluate_trace
from ambient_trainer.simulator import logged, simulate
from ambient_trainer.simulator.device import load_device
from ambient_trainer.simulator.fleet import drawn, nominal

PERIOD_S = 5.0
ZONES = load_device().main_zones
UNIT = nominal(ZONES)


def traces(*asked):
    return [each.trace for each in logged([run_of(*each, PERIOD_S) for each in asked], PERIOD_S)]


def test_the_nominal_unit_logs_what_the_simulated_phone_does():
    found = traces((UNIT, False, "2.5", 3), (UNIT, True, "2.5", 3))[0]
    expected = simulate("2.5", seed=3, period_s=PERIOD_S).trace
    assert found.columns.keys() == expected.columns.keys()
    for name, values in expected.columns.items():
        np.testing.assert_array_equal(found.columns[name], values)


def test_a_gain_acts_about_25_degC_and_an_offset_everywhere():
    usb = next(index for index, zone in enumerate(ZONES) if zone.name == "usb")
    moved = ZONES[usb].model_copy(update={"offset_degC": 0.4, "step_degC": 1e-6, "noise_degC": 0.0})
    still = ZONES[usb].model_copy(update={"step_degC": 1e-6, "noise_degC": 0.0})
    off = replace(UNIT, zones=(*ZONES[:usb], moved, *ZONES[usb + 1 :]), gains={"usb": 0.02})
    on = replace(UNIT, zones=(*ZONES[:usb], still, *ZONES[usb + 1 :]))
    skewed, straight = traces((off, False, "3", 3), (on, False, "3", 3))
    plain = straight.columns["usb_degC"]
    np.testing.assert_allclose(skewed.columns["usb_degC"], plain + 0.4 + 0.02 * (plain - 25.0), atol=2e-6)
    for name in ("soc_degC", "display_degC", "ambient_degC"):
        np.testing.assert_array_equal(skewed.columns[name], straight.columns[name])


def test_a_case_keeps_a_phone_warmer_at_rest_and_slower_under_load():
    asked = [(UNIT, cased, name, 3) for name in ("1", "2.1") for cased in (False, True)]
    rise = [trace.columns["battery_degC"] - trace.reference for trace in traces(*asked)]
    assert rise[1].mean() > rise[0].mean() + 0.03
    third = slice(len(rise[2]) // 2, 3 * len(rise[2]) // 4)
    assert rise[3][third].mean() < rise[2][third].mean() - 0.2


PLAN = Plan(count=5, seed=2, scenarios=("1",), period_s=5.0)


@pytest.fixture(scope="module")
def done(free_model):
    seen = []
    found = study(free_model, PLAN, 1, lambda *each: seen.append(each))
    assert seen[0] == ("6 phones", 0, 6)
    assert seen[-1] == ("6 phones", 6, 6)
    return found


def test_a_unit_is_scored_as_by_hand(done, free_model):
    unit = drawn(5, 2, load_device().main_zones)
    calibration, bare, cased = traces((unit, False, CALIBRATION, 2005), (unit, False, "1", 2), (unit, True, "1", 2))
    scored = done.units[4]
    assert scored.number == 5
    known = evaluate_trace(free_model, calibration).error_degC[30 * 60 // 5 :]
    assert scored.offset_degC == pytest.approx(known.mean(), abs=1e-9)
    for score, trace in zip(scored.scores, (bare, cased)):
        error = evaluate_trace(free_model, trace).error_degC
        assert score.rmse_degC == pytest.approx(np.sqrt(np.mean(error**2)), rel=1e-9)
        assert score.bias_degC == pytest.approx(error.mean(), rel=1e-9)
        left = error - scored.offset_degC
        assert score.corrected_rmse_degC == pytest.approx(np.sqrt(np.mean(left**2)), rel=1e-6)
        assert score.corrected_bias_degC == pytest.approx(left.mean(), abs=1e-6)
        assert score.scatter_degC == pytest.approx(error.std(ddof=1), rel=1e-9)
        low, high = free_model.main.interval[90]
        assert score.inside90_percent == pytest.approx(100 * np.mean((low <= error) & (error <= high)), abs=0.2)
    assert [score.cased for score in scored.scores] == [False, True]


def test_readings_of_a_week_teach_units_their_offset_and_a_liar_none(done, free_model):
    time_s = np.arange(0.0, 36000.0, 5.0)  # the free filter settles after hours
    columns = {each.column: np.full(len(time_s), 21.0) for each in free_model.main.inputs}
    quiet = Trace("day", time_s, {**columns, "ambient_degC": np.full(len(time_s), 21.0)})
    error = evaluate_trace(free_model, quiet).error_degC[-1]
    lower = replace(quiet, columns={**quiet.columns, "ambient_degC": quiet.reference - error + 0.8})
    assert 0.3 < offsets_by_day(free_model, 1, 1, [lower] * 7)[-1].offset_degC < 1
    assert {each.offset_degC for each in offsets_by_day(free_model, 1, 1, [lower] * 7, LIE_DEGC)} == {0.0}
    for unit in done.units:
        for score in unit.scores:
            assert score.learnt_bias_degC == pytest.approx(score.bias_degC - unit.learnt_offset_degC)


def test_units_prints_writes_and_draws(figures, saved, free_model, tmp_path):
    report = tmp_path / "report"
    options = ("--count", 2, "--scenarios", "1", "--period", 5, "--jobs", 1, "--report", report)
    found, out = figures("units", saved(free_model), *options)
    assert found["plan"] == {"count": 2, "seed": 1, "scenarios": ["1"], "period_s": 5.0}
    for group in found["groups"]:
        assert f" {group['as it is']['rmse_degC']['median']:.2f} " in out
    assert out.splitlines()[-2:] == [f"Figures: {tmp_path}/figures.json", f"Report: {report}/index.html"]
    assert "Scenario 1, in its case" in (report / "index.html").read_text()


@pytest.fixture(scope="session")
def free_model() -> Model:
    """A filter of order 2, for a period of 5 s."""
    return model_of(estimator("free-2").fit([simulate("5", period_s=PERIOD_S).trace], Effort(starts=1)), [], {})
