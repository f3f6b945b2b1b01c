"""``free-1`` to ``free-4``: the free linear filter of that order over any temperatures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from threadpoolctl import threadpool_limits

from ambient_trainer.data.trace import Trace
from ambient_trainer.estimation.free_filter import FreeFilter
from ambient_trainer.estimation.search import Progress
from ambient_trainer.estimators.base import USUAL, Effort, Fit
from ambient_trainer.estimators.searched import MODES, filter_parameters, fit_of, searched
from ambient_trainer.estimators.training import estimator_data, require_enough

NAMES = ("free-1", "free-2", "free-3", "free-4")


def find(name: str) -> FreeFilterEstimator | None:
    """The estimator called ``name``, or None."""
    return FreeFilterEstimator(NAMES.index(name) + 1) if name in NAMES else None


@dataclass(frozen=True)
class FreeFilterEstimator:
    """Fits the free linear filter of ``order``."""

    order: int
    reads_any = True

    @property
    def name(self) -> str:
        """``free-N``."""
        return f"free-{self.order}"

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
        columns, segments = estimator_data(traces, inputs, period_s, effort.pieces)
        structure = FreeFilter(self.order, segments)
        require_enough(traces, structure)
        with threadpool_limits(1):
            found = searched(structure, effort, progress)
            best = found.result.best
            return fit_of(
                found,
                structure.system(best.theta, best.beta),
                filter_parameters(structure, found),
                circuit=self.name,
                inputs=columns,
                states=MODES[: self.order],
            )
