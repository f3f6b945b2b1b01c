"""A related method as an estimator of the product's contract: it names its own columns and is no linear system."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from ambient_model.model import Quantiles
from ambient_studies.thesis.related._samples import estimated
from ambient_trainer.data import Array, Trace
from ambient_trainer.estimation import Progress
from ambient_trainer.estimators import USUAL, Effort, error_quantiles


class Predictor(Protocol):
    """What a method holds once it is trained."""

    @property
    def identifiable(self) -> bool:
        """Whether the training data determine every parameter."""

    def ambient_degC(self, time_s: Array, rows: Array) -> Array:
        """The ambient, shape (n,), from samples (m, n) without gaps at ``time_s`` (n,)."""


@dataclass(frozen=True)
class RelatedFit:
    """A trained method, with its errors (true minus estimate) on the training samples."""

    circuit: str
    inputs: tuple[str, ...]
    predictor: Predictor
    errors_degC: Array
    fallbacks: Mapping[str, RelatedFit] = field(default_factory=dict)

    @property
    def rmse_degC(self) -> float:
        """Root mean square error on the training samples."""
        return float(np.sqrt(np.mean(self.errors_degC**2)))

    @property
    def identifiable(self) -> bool:
        """Whether the training data determine every parameter."""
        return self.predictor.identifiable

    @property
    def interval_degC(self) -> Quantiles:
        """Per level in percent the training errors between which that share lies."""
        return error_quantiles(self.errors_degC)

    def discrete(self, period_s: float) -> None:
        """None: no device runs it."""

    def estimate_degC(self, trace: Trace) -> Array:
        """The ambient, shape (n,), NaN where a column that it reads is missing."""
        return estimated(trace, self.inputs, self.predictor.ambient_degC)


@dataclass(frozen=True)
class RelatedEstimator:
    """A method: ``train`` makes its predictor of the runs of the scenarios ``trained_on``."""

    name: str
    about: str
    inputs: tuple[str, ...]
    train: Callable[[Sequence[Trace]], Predictor]
    trained_on: tuple[str, ...] = ("5",)
    reads_any = False

    def searches(self, effort: Effort) -> int:
        """One, of which no progress is known."""
        return 1

    def fit(
        self,
        traces: Sequence[Trace],
        effort: Effort = USUAL,
        progress: Progress | None = None,
        period_s: float | None = None,
        inputs: Sequence[str] | None = None,
    ) -> RelatedFit:
        """Train on ``traces`` as they were sampled; see :class:`ambient_trainer.estimators.base.Estimator`."""
        predictor = self.train(traces)
        errors = [each.reference - estimated(each, self.inputs, predictor.ambient_degC) for each in traces]
        error = np.concatenate(errors)
        return RelatedFit(self.name, self.inputs, predictor, error[np.isfinite(error)])
