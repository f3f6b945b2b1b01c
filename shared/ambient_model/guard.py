"""Where the guard and the main estimator part, the guard has a say: the rule for how much.

    d = y_main - y_guard
    w = (|d| - threshold) / threshold, but at least 0 and at most 1
    y = y_main - w d

Up to the threshold the main estimator is believed, from twice the threshold on the guard. In between the one passes
into the other without a jump.
"""

from typing import NamedTuple


class Guarded(NamedTuple):
    """What the two say together."""

    ambient_degC: float
    apart_degC: float
    """d: the main estimate minus the guard's."""
    weight: float
    """w: 0 where the main estimator is believed, 1 where the guard is."""


def guarded(main_degC: float, guard_degC: float, threshold_degC: float) -> Guarded:
    """The estimate from the main one and the guard's."""
    apart = main_degC - guard_degC
    weight = min(max((abs(apart) - threshold_degC) / threshold_degC, 0.0), 1.0)
    return Guarded(main_degC - weight * apart, apart, weight)
