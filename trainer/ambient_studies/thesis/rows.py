"""Errors of a method in a scenario: the published figures, where there are any, beside those of a simulated run.

An error is true minus estimate. Samples without an estimate are counted and not scored; a figure that is not finite is
None. What agrees with the thesis and what does not is put into sentences.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from operator import itemgetter

import numpy as np
from scipy.stats import spearmanr

from ambient_studies import Progress
from ambient_studies.thesis.methods import Method, Variant
from ambient_studies.thesis.published import NONCAUSAL, SCENARIOS, Result, Results, method_name
from ambient_trainer.data import Array, Trace
from ambient_trainer.evaluation import score


@dataclass(frozen=True)
class Row:
    """``published`` is None where the thesis gives no figures, ``reproduced`` where there is no finite one."""

    scenario: str
    model: str
    variant: Variant
    published: Result | None
    reproduced: Result | None
    samples: int
    """With an estimate and a reference."""
    without_estimate: int

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
    """Score each trained method on each trace, by its scenario's name, beside the errors that were published."""
    rows: list[Row] = []
    estimates: dict[tuple[str, str, str], Array] = {}
    for scenario, trace in traces.items():
        for method in methods:
            progress("evaluating", len(rows), len(traces) * len(methods))
            # a method that diverges, as one with a misprint does, may overflow on its way
            with np.errstate(over="ignore", invalid="ignore"):
                estimate = method.estimate(trace)
                rows.append(_row(scenario, method, estimate, trace.reference, published))
            estimates[scenario, method.name, method.variant] = estimate
    return Evaluated(tuple(rows), estimates)


def like_published(rows: Sequence[Row]) -> list[Row]:
    """The rows that compare with the thesis's tables (ten models, six scenarios), each in the variant it published."""
    return [
        row
        for row in rows
        if row.published is not None and row.variant == ("noncausal" if row.model == NONCAUSAL else "corrected")
    ]


def spearman(rows: Sequence[Row]) -> float | None:
    """Rank correlation of published and reproduced RMSE over the rows that have both; None for fewer than three."""
    pairs = [(row.published.rmse_degC, row.reproduced.rmse_degC) for row in rows if row.published and row.reproduced]
    correlation = float(spearmanr(*zip(*pairs)).statistic) if len(pairs) > 2 else math.nan
    return correlation if math.isfinite(correlation) else None


def _row(scenario: str, method: Method, estimate: Array, reference: Array, published: Results) -> Row:
    error = reference - estimate
    known = np.isfinite(error)
    samples, reproduced = int(np.count_nonzero(known)), None
    if samples >= 2:
        found = score(error[known])
        if all(map(math.isfinite, (found.rmse_degC, found.mae_degC, found.mbe_degC, found.sigma_degC))):
            reproduced = Result(found.rmse_degC, found.mae_degC, found.mbe_degC, found.interval_degC)
    theirs = published.get((scenario, method.name))
    without = int(np.count_nonzero(~np.isfinite(estimate)))
    return Row(scenario, method.name, method.variant, theirs, reproduced, samples, without)


WANTED_SPEARMAN = 0.85
"""The bar of the calibration of the simulated phone; chosen."""
_FAR = 2.0


@dataclass(frozen=True)
class Verdict:
    """``headline`` sums up; each of ``shortfalls`` is a difference from the thesis."""

    spearman: float | None
    spearman_causal: float | None
    """The same with every estimate causal."""
    compared: int
    within_factor_two: int
    headline: str
    shortfalls: tuple[str, ...]


def verdict(rows: Sequence[Row]) -> Verdict:
    """Compare the rows with the thesis's."""
    compared = like_published(rows)
    correlation = spearman(compared)
    causal = spearman([row for row in rows if row.published is not None and row.variant == "corrected"])
    near = sum(row.ratio is not None and 1 / _FAR <= row.ratio <= _FAR for row in compared)
    headline = (
        f"Over {len(compared)} pairs of model and scenario, published and simulated RMSE rank alike with a Spearman "
        f"correlation of {_shown(correlation)}; {near} simulated figures lie within a factor of {_FAR:g} of the "
        "published ones."
    )
    shortfalls = tuple(_shortfalls(compared, correlation, causal))
    return Verdict(correlation, causal, len(compared), near, headline, shortfalls)


def _shortfalls(rows: Sequence[Row], correlation: float | None, causal: float | None) -> Iterator[str]:
    """What ranks unlike, another best model, and pairs that differ by more than a factor of two, farthest first."""
    if correlation is None or correlation < WANTED_SPEARMAN:
        yield f"The rank correlation of {_shown(correlation)} falls short of the wanted {WANTED_SPEARMAN}."
    if causal is not None:
        yield (
            f"With Model 1 state-space single input evaluated causally too, as a device must, it is {causal:.2f}: the "
            "published figures of that model have seen the reference (erratum 9)."
        )
    for scenario in SCENARIOS:
        here = [(row.published, row.reproduced, row.model) for row in rows if row.scenario == scenario]
        known = [(one.rmse_degC, other.rmse_degC, method_name(model)) for one, other, model in here if one and other]
        if known:
            published, simulated = (min(known, key=itemgetter(column))[2] for column in (0, 1))
            if published != simulated:
                yield f"Scenario {scenario}: the thesis's best is {published}, the simulated phone's {simulated}."
    far = [(row.ratio, row) for row in rows if row.ratio is not None and not 1 / _FAR <= row.ratio <= _FAR]
    for _, row in sorted(far, key=lambda each: -max(each[0], 1 / max(each[0], 1e-12))):
        if row.reproduced and row.published:
            errors = f"{row.reproduced.rmse_degC:.2f} degC simulated, {row.published.rmse_degC:.2f} published"
            yield f"Scenario {row.scenario}, {method_name(row.model)}: RMSE {errors}."
    lost = [row for row in rows if row.reproduced is None]
    yield from (f"Scenario {row.scenario}, {method_name(row.model)}: no finite figure." for row in lost)


def _shown(correlation: float | None) -> str:
    return "none" if correlation is None else f"{correlation:.2f}"
