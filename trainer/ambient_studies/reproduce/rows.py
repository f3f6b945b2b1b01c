"""A row is one method in one scenario: its published figures, where there are any, beside those of a simulated run.

Every estimate is causal but that of the variant ``noncausal``. An error is true minus estimate. Where an estimate is
missing there is no error to count; a figure that is not a finite number is none.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import spearmanr

from ambient_studies.reproduce.runs import Progress
from ambient_studies.thesis.published import Result
from ambient_trainer.data.trace import Array, Trace
from ambient_trainer.estimators.method import Method, Variant
from ambient_trainer.evaluation.metrics import Metrics, score

NONCAUSAL_AS_PUBLISHED = ("model1_ss_single_input",)
"""The models whose published figures can only come from an estimate that saw the reference (erratum 9)."""


Results = Mapping[tuple[str, str], Result]
"""By scenario and model."""


@dataclass(frozen=True)
class Row:
    """``published`` is None where the thesis gives no figures, ``reproduced`` where there is no finite one."""

    scenario: str
    model: str
    variant: Variant
    published: Result | None
    reproduced: Result | None
    samples: int
    """How many samples had an estimate and a reference."""
    without_estimate: int

    @property
    def like_published(self) -> bool:
        """Whether the published figures were found this way: corrected, and causal but where they cannot have been."""
        return self.variant == ("noncausal" if self.model in NONCAUSAL_AS_PUBLISHED else "corrected")

    @property
    def ratio(self) -> float | None:
        """Reproduced over published RMSE, where both are known."""
        if self.published is None or self.reproduced is None:
            return None
        return self.reproduced.rmse_degC / self.published.rmse_degC


@dataclass(frozen=True)
class Evaluated:
    """The rows, and every estimate by (scenario, model, variant) in degC, shape (n,)."""

    rows: tuple[Row, ...]
    estimates: Mapping[tuple[str, str, str], Array]


def evaluate(
    methods: Sequence[Method], traces: Mapping[str, Trace], published: Results, progress: Progress
) -> Evaluated:
    """Each of ``methods`` on each of ``traces`` (by scenario)."""
    rows: list[Row] = []
    estimates: dict[tuple[str, str, str], Array] = {}
    pairs = [(scenario, trace, method) for scenario, trace in traces.items() for method in methods]
    for index, (scenario, trace, method) in enumerate(pairs):
        progress("evaluating", index, len(pairs))
        # a method that diverges, as one with a misprint does, may overflow on its way
        with np.errstate(over="ignore", invalid="ignore"):
            estimate = method.estimate(trace)
            rows.append(_row(scenario, method, estimate, trace.reference, published))
        estimates[scenario, method.name, method.variant] = estimate
    return Evaluated(tuple(rows), estimates)


def spearman(rows: Sequence[Row]) -> float | None:
    """The rank correlation of published and reproduced RMSE over ``rows`` that have both; None for fewer than three."""
    pairs = [(row.published.rmse_degC, row.reproduced.rmse_degC) for row in rows if row.published and row.reproduced]
    found = float(spearmanr(*zip(*pairs)).statistic) if len(pairs) > 2 else math.nan
    return found if math.isfinite(found) else None


def like_published(rows: Sequence[Row]) -> list[Row]:
    """The rows that can be held against the thesis's tables: ten models, six scenarios."""
    return [row for row in rows if row.published is not None and row.like_published]


def figures_of(metrics: Metrics) -> Result | None:
    """The figures of ``metrics``; None where one is not finite."""
    numbers = [metrics.rmse_degC, metrics.mae_degC, metrics.mbe_degC, metrics.sigma_degC]
    if not all(map(math.isfinite, numbers)):
        return None
    return Result(metrics.rmse_degC, metrics.mae_degC, metrics.mbe_degC, metrics.interval_degC)


def _row(scenario: str, method: Method, estimate: Array, reference: Array, published: Results) -> Row:
    error = reference - estimate
    known = np.isfinite(error)
    samples = int(np.count_nonzero(known))
    return Row(
        scenario=scenario,
        model=method.name,
        variant=method.variant,
        published=published.get((scenario, method.name)),
        reproduced=figures_of(score(error[known])) if samples >= 2 else None,
        samples=samples,
        without_estimate=int(np.count_nonzero(~np.isfinite(estimate))),
    )
