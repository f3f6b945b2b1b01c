"""``observer``: the default. Of one sensor the Kalman filter of a circuit, of several the constrained free filter.

A lone sensor has no differences to others that a free filter could learn from, and two constants make its circuit.
"""

from __future__ import annotations

from ambient_trainer.estimation.search import Progress
from ambient_trainer.estimators.base import Effort, FilterEstimator, Fit
from ambient_trainer.estimators.library.circuit_observer import CircuitObserver
from ambient_trainer.estimators.library.free_observer import FreeObserver
from ambient_trainer.estimators.training import Training

NAMES = ("observer",)


def find(name: str) -> Observer | None:
    """The estimator called ``name``, or None."""
    return Observer() if name in NAMES else None


class Observer(FilterEstimator):
    """Fits the kind of observer that suits the number of sensors; the fit names it."""

    name = NAMES[0]

    def fit_to(self, training: Training, effort: Effort, progress: Progress | None) -> Fit:
        """The fit to grids of these columns."""
        kind = CircuitObserver() if len(training.columns) == 1 else FreeObserver()
        return kind.fit_to(training, effort, progress)
