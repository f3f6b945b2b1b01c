"""The names that other rooms still fit by; use ``registry.estimator`` and ``base`` instead."""

from __future__ import annotations

from collections.abc import Sequence

from ambient_trainer.data.trace import Trace
from ambient_trainer.estimation.search import Progress
from ambient_trainer.estimators.base import USUAL, Effort, Fit
from ambient_trainer.estimators.circuit import fit_circuit
from ambient_trainer.estimators.library.free import FreeFilterEstimator

__all__ = ["Effort", "Fit", "fit_circuit", "fit_free_filter"]


def fit_free_filter(
    order: int,
    traces: Sequence[Trace],
    effort: Effort = USUAL,
    progress: Progress | None = None,
    period_s: float | None = None,
    inputs: Sequence[str] | None = None,
) -> Fit:
    """Fit the free linear filter of ``order``."""
    return FreeFilterEstimator(order).fit(traces, effort, progress, period_s, inputs)
