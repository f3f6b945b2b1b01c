"""The limit of models whose place beside it is known, and the command ``limit``."""

import json

import numpy as np
import pytest

from ambient_model.faults import Refused
from ambient_studies.lower_bound.report import report_of
from ambient_studies.lower_bound.study import Seeds, lower_bounds
from ambient_trainer.estimators.base import Effort
from ambient_trainer.estimators.library.free import FreeFilterEstimator
from ambient_trainer.estimators.model_file import model_of
from ambient_trainer.simulator import simulate_many

SCENARIO, PERIOD_S = "2.5", 5.0
SEEDS = Seeds((6, 7, 8), (3, 4))


@pytest.fixture(scope="module")
def model_of_the_scenario():
    """A free filter of order 2, fitted to the scenario itself: to the runs that the bound is fitted to."""
    traces = [each.trace for each in simulate_many([(SCENARIO, seed) for seed in SEEDS.fitted], PERIOD_S)]
    return model_of(FreeFilterEstimator(2).fit(traces, Effort(starts=4)), [], {})


@pytest.fixture(scope="module")
def found(model_of_the_scenario):
    seen = []
    [bound] = lower_bounds(model_of_the_scenario, [SCENARIO], SEEDS, PERIOD_S, lambda *each: seen.append(each))
    assert [what for what, _, _ in seen[-4:]] == [
        f"scenario {SCENARIO}: {step}" for step in ("model", "its own order", "bank", "every zone")
    ]
    return bound


def test_a_model_that_was_fitted_to_the_scenario_is_its_own_bound(found):
    own = found.filters[0]
    assert own.name == "free filter of order 2"
    assert (own.sensors, own.weights) == (5, 2 + 5 * 3 + 1)
    assert found.ratio(own) == pytest.approx(1.0, abs=0.01)


def test_the_filters_see_more_and_more(found):
    assert [each.sensors for each in found.filters] == [5, 5, 54]
    assert [each.weights for each in found.filters] == [18, 5 * 15 + 1, 54 * 6 + 1]
    for each in found.filters:
        assert 0.02 < each.rmse_degC < 1.0


def test_the_models_error_is_over_the_scored_runs(constant):
    [bound] = lower_bounds(constant(21.0), [SCENARIO], SEEDS, PERIOD_S, lambda *_: None)
    traces = [each.trace for each in simulate_many([(SCENARIO, seed) for seed in SEEDS.scored], PERIOD_S)]
    mean_squares = [np.mean((trace.reference - 21.0) ** 2) for trace in traces]
    assert bound.model_rmse_degC == pytest.approx(np.sqrt(np.mean(mean_squares)), rel=1e-9)
    assert bound.samples == sum(len(trace.time_s) for trace in traces)
    assert bound.filters[0].name == "free filter of order 1"
    assert bound.filters[0].sensors == 1


def test_another_devices_model_is_refused_before_anything_is_simulated(constant, monkeypatch):
    monkeypatch.setattr("ambient_studies.lower_bound.study.simulate_many", None)
    with pytest.raises(Refused, match="reads ch102_degC, which the simulated phone does not log"):
        lower_bounds(constant(20.0, "ch102"), [SCENARIO], SEEDS, PERIOD_S, lambda *_: None)


def test_seeds_never_overlap():
    assert Seeds.after((3, 9, 5), 3) == Seeds((10, 11, 12), (3, 9, 5))


def test_the_report_holds_every_figure(found, model_of_the_scenario):
    report = report_of(model_of_the_scenario, [found], SEEDS)
    (table,) = report.sections[0].blocks
    assert table.rows[0][:3] == (SCENARIO, "free-2", "5")
    assert table.rows[1][-1] == f"{found.ratio(found.filters[0]):.2f}"
    assert report.data["scenarios"][0]["filters"][2]["rmse_degC"] == found.filters[2].rmse_degC
    assert report.data["seeds"] == {"fitted": (6, 7, 8), "scored": (3, 4)}
    findings = report.sections[1].blocks
    assert f"{found.model_rmse_degC:.3f}" in findings[0].text
    behind = [each.name for each in found.filters if each.rmse_degC > found.model_rmse_degC]
    assert [each.status for each in findings[1:]] == ["warning"] * bool(behind)
    assert all(name in findings[1].text for name in behind)


def test_the_command_prints_and_writes(trainer, saved, constant, tmp_path):
    figures = tmp_path / "out.json"
    options = ("--scenarios", "1,2.5", "--seeds", "3", "--fitted", 2, "--period", 5, "--json", figures)
    status, out, err = trainer("limit", saved(constant(22.0)), *options)
    assert (status, err) == (0, "")
    found = json.loads(figures.read_text())
    assert [each["scenario"] for each in found["scenarios"]] == ["1", "2.5"]
    assert found["simulated"] is True
    for each in found["scenarios"]:
        assert f" {each['model_rmse_degC']:.3f} " in out
    assert "simulated" in out
