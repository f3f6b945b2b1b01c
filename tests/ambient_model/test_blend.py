"""The secondary estimator's rule: which is used where; ``parity`` holds it against numpy over thousands of samples."""

import pytest

from ambient_model.blend import blended


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
