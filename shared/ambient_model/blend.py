"""Blend of the main and the secondary estimator, which takes precedence where the two lie far apart.

    d = y_main - y_secondary
    w = (|d| - threshold) / threshold, limited to 0 to 1
    y = y_main - w d

Up to the threshold y is the main estimate, from twice the threshold on the secondary one; in between it is continuous.
The model file's key of the secondary estimator is ``guard``.
"""

from typing import NamedTuple


class Blended(NamedTuple):
    """The result of :func:`blended`."""

    ambient_degC: float
    """y."""
    difference_degC: float
    """d: the main estimate minus the secondary one."""
    weight: float
    """w: 0 is the main estimator alone, 1 the secondary one alone."""


def blended(main_degC: float, secondary_degC: float, threshold_degC: float) -> Blended:
    """Blend of the main and the secondary estimate."""
    difference = main_degC - secondary_degC
    weight = min(max((abs(difference) - threshold_degC) / threshold_degC, 0.0), 1.0)
    return Blended(main_degC - weight * difference, difference, weight)
