"""The secondary estimator's rule: which is used where."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ambient_model.blend import blended

temperatures_degC = st.floats(-100, 100)
thresholds_degC = st.floats(0.01, 20)


@pytest.mark.parametrize(
    ("main", "guard", "said", "weight"),
    [
        (20.0, 20.0, 20.0, 0.0),
        (22.0, 20.0, 22.0, 0.0),  # at the threshold
        (18.0, 20.0, 18.0, 0.0),
        (23.0, 20.0, 21.5, 0.5),  # half way: 23 - 0.5 * 3
        (17.0, 20.0, 18.5, 0.5),
        (24.0, 20.0, 20.0, 1.0),  # twice the threshold
        (60.0, 20.0, 20.0, 1.0),
        (-60.0, 20.0, 20.0, 1.0),
    ],
)
def test_a_threshold_of_2_degC(main: float, guard: float, said: float, weight: float) -> None:
    assert blended(main, guard, 2.0) == (said, main - guard, weight)


@given(temperatures_degC, temperatures_degC, thresholds_degC)
def test_the_weight_rises_from_0_at_the_threshold_to_1_at_twice_that(main: float, guard: float, threshold: float):
    """So the estimate lies between the two, and nothing jumps."""
    found, weight = blended(main, guard, threshold), np.interp(abs(main - guard), [threshold, 2 * threshold], [0, 1])
    assert found.weight == pytest.approx(weight, abs=1e-9)
    assert (found.weight == 0) == (abs(main - guard) <= threshold)
    assert found.ambient_degC == pytest.approx(main - weight * (main - guard), abs=1e-9)
    assert found.weight > 0 or found.ambient_degC == main
