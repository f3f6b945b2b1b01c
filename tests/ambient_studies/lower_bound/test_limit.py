"""The limit of models whose place beside it is known."""

from __future__ import annotations

import numpy as np
import pytest

from ambient_model.faults import Refused
from ambient_studies.lower_bound.limit import Seeds, limits
from ambient_studies.lower_bound.summary import as_json, limit_table, sentences
from ambient_trainer.simulator.simulate import simulate_many

SCENARIO, PERIOD_S = "2.5", 5.0
SEEDS = Seeds((6, 7, 8), (3, 4))


@pytest.fixture(scope="module")
def found(taught_the_scenario):
    told = []
    [limit] = limits(taught_the_scenario, [SCENARIO], SEEDS, PERIOD_S, lambda *each: told.append(each))
    assert [what for what, _, _ in told[-4:]] == [
        f"scenario {SCENARIO}: {step}" for step in ("model", "its own order", "bank", "every zone")
    ]
    return limit


def test_a_model_that_was_fitted_to_the_scenario_is_its_own_limit(found):
    own = found.filters[0]
    assert own.name == "free filter of order 2"
    assert (own.reads, own.weights) == (5, 2 + 5 * 3 + 1)
    assert found.ratio(own) == pytest.approx(1.0, abs=0.01)


def test_the_filters_see_more_and_more(found):
    assert [each.reads for each in found.filters] == [5, 5, 54]
    assert [each.weights for each in found.filters] == [18, 5 * 15 + 1, 54 * 6 + 1]
    for each in found.filters:
        assert 0.02 < each.rmse_degC < 1.0


def test_the_models_error_is_over_the_scored_runs(constant):
    [limit] = limits(constant(21.0), [SCENARIO], SEEDS, PERIOD_S, lambda *_: None)
    traces = [each.trace for each in simulate_many([(SCENARIO, seed) for seed in SEEDS.scored], PERIOD_S)]
    mean_squares = [np.mean((trace.reference - 21.0) ** 2) for trace in traces]
    assert limit.model_rmse_degC == pytest.approx(np.sqrt(np.mean(mean_squares)), rel=1e-9)
    assert limit.samples == sum(len(trace.time_s) for trace in traces)
    assert limit.filters[0].name == "free filter of order 1"
    assert limit.filters[0].reads == 1


def test_another_devices_model_is_refused_before_anything_is_simulated(constant, monkeypatch):
    monkeypatch.setattr("ambient_studies.lower_bound.limit.simulate_many", None)
    with pytest.raises(Refused, match="reads ch102_degC, which the simulated phone does not log"):
        limits(constant(20.0, "ch102"), [SCENARIO], SEEDS, PERIOD_S, lambda *_: None)


def test_seeds_never_overlap():
    assert Seeds.after((3, 9, 5), 3) == Seeds((10, 11, 12), (3, 9, 5))


def test_words_and_figures_agree(found, taught_the_scenario):
    table = limit_table(taught_the_scenario, [found])
    assert table.rows[0][:3] == (SCENARIO, "free-2", "5")
    assert table.rows[1][-1] == f"{found.ratio(found.filters[0]):.2f}"
    told = as_json(taught_the_scenario, [found], SEEDS)
    assert told["scenarios"][0]["filters"][2]["rmse_degC"] == found.filters[2].rmse_degC
    assert told["seeds"] == {"fitted": [6, 7, 8], "scored": [3, 4]}
    said = sentences([found])
    assert said[0].startswith(f"Scenario {SCENARIO}: the model is {found.model_rmse_degC:.3f} degC off, ")
    behind = [each.name for each in found.filters if each.rmse_degC > found.model_rmse_degC]
    assert all(name in said[1] for name in behind)
    assert len(said) == 1 + bool(behind)
