"""How many sensors: the Pareto front, and the fewest within one standard error of the best (Breiman et al. 1984).

The standard error is that of the mean square over the blocks: blocks differ, and so would other runs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class HeldOut:
    """Sums of squared errors in degC^2 and samples, one a block."""

    squares: tuple[float, ...]
    samples: tuple[float, ...]

    @property
    def mean_square(self) -> float:
        """Over all held-out samples, in degC^2."""
        return sum(self.squares) / sum(self.samples)

    @property
    def rmse_degC(self) -> float:
        """The root of it."""
        return float(np.sqrt(self.mean_square))

    @property
    def standard_error_degC2(self) -> float:
        """Of the mean square."""
        each = np.asarray(self.squares) / np.asarray(self.samples)
        return float(np.std(each, ddof=1) / np.sqrt(len(each)))

    @property
    def band_degC(self) -> tuple[float, float]:
        """The RMSE one standard error down and up."""
        low = max(self.mean_square - self.standard_error_degC2, 0.0)
        return float(np.sqrt(low)), float(np.sqrt(self.mean_square + self.standard_error_degC2))


def pareto_front(errors: Sequence[float]) -> list[int]:
    """The places whose error is below that of all before them."""
    return [index for index, error in enumerate(errors) if all(error < other for other in errors[:index])]


def fewest_within_one_error(sizes: Sequence[HeldOut]) -> int:
    """The first place whose mean square is at most the least one plus its standard error."""
    best = min(sizes, key=lambda each: each.mean_square)
    limit = best.mean_square + best.standard_error_degC2
    return next(index for index, each in enumerate(sizes) if each.mean_square <= limit)


def flat_from(errors: Sequence[float], gain_degC: float) -> int:
    """The first place after which no error is lower by more than ``gain_degC``."""
    return next(index for index, error in enumerate(errors) if error - min(errors[index:]) <= gain_degC)
