"""Estimators that fit a filter over whatever temperatures they are given: what they share."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence

from threadpoolctl import threadpool_limits

from ambient_trainer.data.trace import Trace
from ambient_trainer.estimation.search import Progress
from ambient_trainer.estimators.base import USUAL, Effort, Fit
from ambient_trainer.estimators.training import Training


class FilterEstimator(ABC):
    """Keeps the contract of :class:`ambient_trainer.estimators.base.Estimator`; a subclass fits."""

    name: str
    reads_any = True

    def searches(self, effort: Effort) -> int:
        """One a start."""
        return effort.starts

    def fit(
        self,
        traces: Sequence[Trace],
        effort: Effort = USUAL,
        progress: Progress | None = None,
        period_s: float | None = None,
        inputs: Sequence[str] | None = None,
    ) -> Fit:
        """Fit; see :class:`ambient_trainer.estimators.base.Estimator`."""
        training = Training.of(traces, inputs, period_s, effort.pieces)
        with threadpool_limits(1):
            return self.fit_to(training, effort, progress)

    @abstractmethod
    def fit_to(self, training: Training, effort: Effort, progress: Progress | None) -> Fit:
        """The fit to grids of these columns."""
