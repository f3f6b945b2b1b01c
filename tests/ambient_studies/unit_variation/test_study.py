"""The study against its own pieces, put together by hand, and against what must hold whatever is drawn."""

from types import SimpleNamespace

import numpy as np
import pytest

from ambient_model.faults import Refused
from ambient_studies.unit_variation.report import report_of, scatter
from ambient_studies.unit_variation.study import CALIBRATION, LIE_DEGC, Asked, Plan, learnt, study, traces
from ambient_trainer.evaluation.evaluate import evaluate_trace
from ambient_trainer.simulator.device import load_device
from ambient_trainer.simulator.fleet import drawn

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
    calibration, bare, cased = traces(
        [Asked(unit, False, CALIBRATION, 2005), Asked(unit, False, "1", 2), Asked(unit, True, "1", 2)], 5.0
    )
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
        inside = 100 * np.mean((low <= error) & (error <= high))
        assert score.inside90_percent == pytest.approx(inside, abs=0.2)
    assert [score.cased for score in scored.scores] == [False, True]


@pytest.mark.slow
def test_processes_change_nothing(done, free_model):
    assert study(free_model, PLAN, 2, lambda *_: None) == done


def test_units_differ_and_their_offset_mends_some_of_it(done):
    before, after = scatter(done, 0, "bias_degC"), scatter(done, 0, "corrected_bias_degC")
    assert before.deviation > 0.05
    assert after.deviation < before.deviation


def test_readings_of_a_week_teach_units_their_offset_and_a_liar_none(done):
    rows = 2400
    day = SimpleNamespace(time_s=np.arange(rows), status=np.full(rows, "degraded"), reference_degC=np.full(rows, 21.6))
    day.estimate_degC, day.low_degC, day.high_degC = (np.full(rows, each) for each in (21.0, 20.5, 21.5))
    offsets = [learnt(number, 1, [day] * 7) for number in range(200)]
    R, P = 0.25 + (0.5 / 1.645) ** 2, 0.25
    assert np.mean(offsets, axis=0)[-1] == pytest.approx(0.6 * 7 * P / (7 * P + R), abs=0.05)
    assert max(map(abs, learnt(1, 1, [day] * 7, LIE_DEGC))) == 0
    for unit in done.units:
        for score in unit.scores:
            assert score.learnt_bias_degC == pytest.approx(score.bias_degC - unit.learnt_offset_degC)


def test_the_report_holds_every_figure(done):
    report = report_of(done)
    table, *findings = report.sections[0].blocks
    assert [row[2] for row in table.rows] == ["as it is", "corrected", "learnt"] * 2
    rmse = [each.scores[0].rmse_degC for each in done.units]
    assert table.rows[0][4] == f"{np.median(rmse):.2f}"
    assert table.rows[0][6] == f"{max(rmse):.2f}"
    assert report.data["groups"][0]["as it is"]["rmse_degC"]["median"] == np.median(rmse)
    assert [each["number"] for each in report.data["units"]] == list(range(6))
    assert f"{np.median(rmse):.2f} degC" in findings[0].text
    assert f"{np.std([each.offset_degC for each in done.units]):.2f} degC" in findings[-2].text


def test_another_devices_model_is_refused(free_model):
    inputs = (free_model.main.inputs[0]._replace(name="ch102"), *free_model.main.inputs[1:])
    other = free_model._replace(main=free_model.main._replace(inputs=inputs))
    with pytest.raises(Refused, match="reads ch102_degC"):
        study(other, PLAN, 1, lambda *_: None)
