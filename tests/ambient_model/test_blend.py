"""The guard's rule: whom it believes where, and that nothing jumps on the way."""

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
def test_the_estimate_lies_between_the_two(main: float, guard: float, threshold: float) -> None:
    found = blended(main, guard, threshold)
    assert min(main, guard) - 1e-9 <= found.ambient_degC <= max(main, guard) + 1e-9
    assert 0 <= found.weight <= 1
    assert (found.weight == 0) == (abs(main - guard) <= threshold)
    if found.weight == 0:
        assert found.ambient_degC == main


@given(temperatures_degC, temperatures_degC, temperatures_degC, thresholds_degC)
def test_nothing_jumps(main: float, other: float, guard: float, threshold: float) -> None:
    """The estimate follows the main one by at most twice, the guard by at most three times what they move by."""
    before, after = blended(main, guard, threshold), blended(other, guard, threshold)
    assert abs(after.ambient_degC - before.ambient_degC) <= 2 * abs(other - main) + 1e-9
    before, after = blended(guard, main, threshold), blended(guard, other, threshold)
    assert abs(after.ambient_degC - before.ambient_degC) <= 3 * abs(other - main) + 1e-9
