"""``free-1`` to ``free-4``: the free linear filter of that order over any temperatures."""

from __future__ import annotations

from ambient_trainer.estimation import FreeFilter, Progress, search
from ambient_trainer.estimators.base import Effort, Estimator, Fit, Training, require_enough
from ambient_trainer.estimators.searched import filter_fit

NAMES = ("free-1", "free-2", "free-3", "free-4")


def find(name: str) -> FreeFilterEstimator | None:
    """The estimator called ``name``, or None."""
    return FreeFilterEstimator(NAMES.index(name) + 1) if name in NAMES else None


class FreeFilterEstimator(Estimator):
    """Fits the free linear filter of ``order``."""

    starts_apart = True

    def __init__(self, order: int) -> None:
        self.order = order
        self.name = f"free-{order}"

    def fit_to(self, training: Training, effort: Effort, progress: Progress | None) -> Fit:
        """The fit to grids of these columns."""
        structure = FreeFilter(self.order, training.segments)
        require_enough(training.traces, structure)
        result = search(structure, effort.starts, effort.seed, progress, effort.budget, effort.first)
        return filter_fit(self.name, training, self.order, result, effort, unit_gain=False)
