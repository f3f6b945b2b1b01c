"""Observer files: what is shipped reads, what is wrong is refused with every fault and its place."""

import copy
from importlib import resources
from typing import Any

import numpy as np
import pytest
import yaml

from ambient_trainer.data.grid import Segment
from ambient_trainer.estimation.search import search
from ambient_trainer.estimators.blended.recipe import find_recipe, read_recipe, recipe_names
from ambient_trainer.estimators.library.recipes import recipe_filter
from refusals import refused

SHIPPED = resources.files("ambient_trainer.estimators.library") / "phone_observer.yaml"
DATA = yaml.safe_load(SHIPPED.read_text())


def faults(data: Any, source: str = "mine.yaml") -> list[str]:
    return [str(each) for each in refused(read_recipe, data, source).faults]


def changed(**places: Any) -> Any:
    """The shipped file with values put at places such as ``heat__measured__into``; ``...`` removes one."""
    data = copy.deepcopy(DATA)
    for place, value in places.items():
        *folders, key = place.split("__")
        part = data
        for folder in folders:
            part = part[folder]
        if value is ...:
            del part[key]
        else:
            part[key] = value
    return data


def test_an_observer_is_found_by_name_or_file_with_its_circuit_and_a_circuit_is_none(write, observer_file):
    assert recipe_names() == ("phone_observer",)
    recipe, circuit = find_recipe("phone_observer")
    assert circuit.name == "phone"
    assert recipe.sensor_columns == tuple(f"{each}_degC" for each in ("soc", "flash", "battery", "usb", "display"))
    assert recipe.drive_columns == ("soc_power_W", "battery_current_A", "cpu_load_frac")
    assert find_recipe("phone") is None
    assert find_recipe("free-2") is None
    assert find_recipe(write("circuit.yaml", "format: ambient-circuit\n")) is None
    recipe, circuit = find_recipe(observer_file)
    assert (recipe.name, circuit.name) == ("brick_observer", "brick")


def test_the_search_for_a_filter_keeps_to_the_bounds_of_the_recipe(observer_file):
    rules = find_recipe(observer_file)[0].filter
    u = 20 + np.cumsum(np.random.default_rng(10).standard_normal((3, 2000)), axis=1)
    structure = recipe_filter({"logged": [Segment(1.0, u, u.mean(axis=0)[None] - 1)]}, {"logged": 1.0}, rules, 1.0)
    best = search(structure, 1, 0).best
    slowest, second = sorted(abs(1 / np.linalg.eigvals(structure.system(best.theta, best.beta).A)))[::-1][:2]
    assert slowest <= rules.slow.slowest_s * 1.01
    assert np.exp(best.theta[1]) >= np.cosh(np.log(rules.slow.least_ratio) / 2) * 0.999
    assert np.exp(best.theta[3]) >= rules.fast.least_damping - 0.001
    assert second > 0


@pytest.mark.parametrize(
    "wrong",
    [
        {
            "version": 2,
            "heat__measured__watts": {"power": 1},
            "made_up__stay_min": [30, 20],
            "unlogged__colour": "red",
            "filter__noise": -1,
            "threshold": ...,
        },
        {
            "sensors__skin": {"lag_s": 5, "trust_degC": 0.2},
            "heat__measured__into": "gpu",
            "unlogged__patterns__charge__watts": [{"usb": 0.3, "plug": 1.0}],
            "weights__main": {"logged": 1, "charging": 1},
            "weights__interval": {"logged": 0},
        },
    ],
    ids=["form", "circuit"],
)
def test_every_fault_is_reported_at_once_with_its_place(wrong):
    found = faults(changed(**wrong))
    assert len(found) == len(wrong)
    for fault, place in zip(found, wrong):
        assert fault.startswith(place.replace("__", "."))


@pytest.mark.parametrize(("name", "facts"), [("model2_ss", ("model2_ss",)), ("phon", ("'phon'", "linear_battery"))])
def test_a_circuit_that_is_unknown_or_not_driven_by_the_ambient_is_refused(name, facts):
    [first, *_] = faults(changed(circuit=name))
    assert first.startswith("circuit: ")
    assert all(fact in first for fact in facts)
