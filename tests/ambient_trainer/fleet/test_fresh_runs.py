"""On runs that no fit saw, half an hour of a unit improves on the population, and intervals hold what they say."""

from dataclasses import replace

import numpy as np
import pytest

import ambient_trainer as at
from ambient_model.codec import load_model
from ambient_trainer.evaluation import evaluate_trace
from ambient_trainer.fleet.dataset import write_dataset
from ambient_trainer.simulator.fleet import FleetPlan, fleet

PLAN = FleetPlan("5", 80, seed=21, period_s=10.0)
LONG = 20


@pytest.mark.slow
def test_half_an_hour_of_a_unit_and_twenty_long_logs(tmp_path):
    units = [*fleet(replace(PLAN, count=LONG)), *list(fleet(replace(PLAN, minutes=30.0)))[LONG:]]
    write_dataset(str(tmp_path / "logs"), ((each.name, each.trace, {"case": each.case}) for each in units))
    at.fit_fleet(tmp_path / "logs", "free-2", tmp_path, engine="serial", within=["case"], effort=at.Effort(starts=2))
    population = load_model(str(tmp_path / "population.json"))
    fresh = [each.trace for each in fleet(replace(PLAN, run=1))]
    models = [load_model(str(tmp_path / "models" / f"{each.name}.json")) for each in units]
    own = [evaluate_trace(model, trace) for model, trace in zip(models, fresh)]
    pooled = [evaluate_trace(population, trace) for trace in fresh]
    errors = {
        name: np.array([each.metrics.rmse_degC for each in found]) for name, found in (("own", own), ("all", pooled))
    }
    assert np.median(errors["own"]) < 0.97 * np.median(errors["all"])
    for found in (own, pooled):
        assert 0.86 < np.mean([each.coverage[90] for each in found]) < 0.94
