"""The search for a filter keeps to the bounds of the recipe."""

import numpy as np

from ambient_trainer.data.grid import Segment
from ambient_trainer.estimation.search import search
from ambient_trainer.estimators.blended.recipe import FilterRules
from ambient_trainer.estimators.library.recipes import recipe_filter

RULES = FilterRules.model_validate(
    {
        "noise": 1e-3,
        "one_degree": 100,
        "slow": {"time_constants_s": [300, 150], "slowest_s": 1500, "least_ratio": 1.5},
        "fast": {"time_s": 20, "damping": 0.8, "least_damping": 0.7},
    }
)


def run(seed: int) -> Segment:
    u = 20 + np.cumsum(np.random.default_rng(seed).standard_normal((3, 2000)), axis=1)
    return Segment(1.0, u, u.mean(axis=0)[None] - 1)


def test_the_search_keeps_to_the_bounds_of_the_recipe():
    structure = recipe_filter({"logged": [run(10)]}, {"logged": 1.0}, RULES, 1.0)
    best = search(structure, 1, 0).best
    theta = best.theta
    slowest, second = sorted(abs(1 / np.linalg.eigvals(structure.system(theta, best.beta).A)))[::-1][:2]
    assert slowest <= 1500 * 1.01
    assert np.exp(theta[1]) >= np.cosh(np.log(1.5) / 2) * 0.999
    assert np.exp(theta[3]) >= 0.699
    assert second > 0
