"""Planted outliers are listed first; on runs that no fit saw, half an hour of a unit improves on the population."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

import ambient_trainer as at
from ambient_model.codec import load_model
from ambient_trainer.evaluation import evaluate_trace
from ambient_trainer.fleet.dataset import Source, entries, write_dataset
from ambient_trainer.fleet.outliers import diagnose_units, learn_typical, least_probable, to_diagnose, typical
from ambient_trainer.simulator.fleet import FleetPlan, fleet
from odd_units import PLANTED


def test_the_least_probable_come_first_and_typical_ones_from_the_middle():
    table = pd.DataFrame({"unit": list("edcba"), "improbability": [0.2, np.nan, 7.0, 0.3, 7.0]})
    assert [each.unit for each in least_probable(table)] == ["a", "c", "b", "e"]
    assert to_diagnose(least_probable(table)) == ["a", "c"]
    assert set(typical(table)) == {"b", "e"}


@pytest.mark.slow
def test_nine_of_ten_planted_outliers_are_among_the_first_fifteen_of_a_thousand(tmp_path):
    found = []

    def rows():
        for each in fleet(FleetPlan("5", 1000, seed=31, period_s=10.0, minutes=180.0, cased=0.0, hide=PLANTED)):
            found.extend([each.name] if each.truth["hidden"] else [])
            yield each.name, each.trace, {"case": each.case}

    write_dataset(str(tmp_path / "logs"), rows())
    fitted = at.fit_fleet(tmp_path / "logs", "free-2", tmp_path, engine="serial", effort=at.Effort(starts=2))
    assert len(found) == len(PLANTED)
    assert len(set(found) & set(fitted.outliers.index[:15])) >= 9


NAMED = {
    "sensor_bias:display:-4K:from=0.0:to=end": ("sensor_bias", "display"),
    "contact:back:0.2W/K:body=hand:from=0.0:to=end": ("contact", "case"),
    "path:flash-usb:0.2W/K:from=0.0:to=end": ("path", "flash-usb"),
}


@pytest.mark.slow
def test_the_cause_of_an_outlier_is_named_beside_typical_units(tmp_path):
    drawn = list(fleet(FleetPlan("5", 24, seed=9, period_s=20.0, minutes=120.0, cased=0.0, hide=tuple(NAMED))))
    write_dataset(str(tmp_path / "logs"), ((each.name, each.trace, {}) for each in drawn))
    causes = {each.name: each.truth["hidden"][0]["cause"] for each in drawn if each.truth["hidden"]}
    places = entries(str(tmp_path / "logs"), Source("unit"))
    (learnt,) = learn_typical([[each for each in places if each.unit not in causes]], Source("unit"), "phone")
    found = diagnose_units([each for each in places if each.unit in causes], Source("unit"), learnt)
    assert {each.unit: each.cause for each in found} == causes
    assert {(each.cause, each.location) for each in found} == set(NAMED.values())
    assert all(each.confidence > 0.5 for each in found)


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
    medians_degC = [np.median([each.metrics.rmse_degC for each in found]) for found in (own, pooled)]
    assert medians_degC[0] < 0.97 * medians_degC[1]
    for found in (own, pooled):
        assert 0.86 < np.mean([each.coverage[90] for each in found]) < 0.94
