"""The first-order response against a fine integration of its differential equation."""

import itertools

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from ambient_studies.related.first_order import lagged


@pytest.mark.parametrize("tau_s", [0.7, 12.0, 900.0])
@pytest.mark.parametrize("spacing", ["even", "uneven"])
def test_the_response_is_that_of_the_differential_equation(tau_s: float, spacing: str) -> None:
    rng = np.random.default_rng(3)
    steps_s = np.ones(120) if spacing == "even" else rng.uniform(0.2, 3.0, 120)
    time_s = np.concatenate([[5.0], 5.0 + np.cumsum(steps_s)])
    values = 20.0 + np.cumsum(rng.normal(0.0, 1.0, 121))

    found = lagged(time_s, values, tau_s)

    def slope(t: float, x: np.ndarray) -> np.ndarray:
        return (np.interp(t, time_s, values) - x) / tau_s

    expected = [values[0]]
    for start, stop in itertools.pairwise(time_s):  # the input has a kink at every sample
        expected.append(solve_ivp(slope, (start, stop), expected[-1:], rtol=1e-11, atol=1e-11).y[0, -1])
    assert found == pytest.approx(np.array(expected), abs=1e-8)


def test_it_starts_in_equilibrium_and_again_after_a_gap_too_long_to_bridge() -> None:
    time_s = np.concatenate([np.arange(50.0), [79.0], 110.0 + np.arange(5.0)])
    values = np.linspace(0.0, 10.0, 56)

    found = lagged(time_s, values, 20.0)

    assert found[0] == values[0]
    assert found[50] != values[50], "30 s are bridged"
    assert found[51] == values[51], "31 s are not"


@pytest.mark.parametrize("count", [1, 2])
def test_few_samples_have_a_response(count: int) -> None:
    assert lagged(np.arange(count, dtype=float), np.full(count, 7.0), 30.0) == pytest.approx(np.full(count, 7.0))
