"""Figures of the benchmark: counts, and shares with Wilson's score interval, which holds near 0 and 1 too."""

import math
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import pandas as pd
from scipy.stats import binomtest

from ambient_trainer.diagnosis import NONE, UNKNOWN, Cause


@dataclass(frozen=True)
class Outcome:
    """``true`` and ``found`` are empty where nothing was hidden or found; ``size_in_noise`` is the effect's RMSE in
    units of the residual's standard deviation without it (of two effects, the smaller one's).

    ``correct`` says whether cause, location and signal were named: of one effect by the first step, of several by some
    step each, and spare steps do not count; where nothing was hidden, whether there is no step. The errors are of the
    first effect, None where it has no magnitude or onset or was not found; ``gain_ci`` is the first step's, in degC.
    ``confidence`` is that of each cause in ``found``; ``onset_right`` (within two minutes) and ``magnitude_right``
    (within a quarter, or in the stated interval) are of the first effect, None where there is nothing to compare.
    """

    true: tuple[Cause, ...]
    size_in_noise: float
    found: tuple[Cause, ...]
    correct: bool
    magnitude_error_frac: float | None
    onset_error_s: float | None
    gain_ci: tuple[float, float] | None
    seconds: float
    confidence: tuple[float, ...] = ()
    onset_right: bool | None = None
    magnitude_right: bool | None = None

    @property
    def named(self) -> tuple[tuple[Cause, float, bool], ...]:
        """Each cause that was named, its confidence, and whether it was hidden."""
        pairs = zip(self.found, self.confidence)
        return tuple((cause, sure, cause in self.true) for cause, sure in pairs if cause.name not in (NONE, UNKNOWN))


LARGE_IN_NOISE = 5.0
"""An effect of at least this size counts as large."""
SIZE_EDGES = (0.0, 0.5, 1.0, 2.0, 3.0, 5.0, 8.0, 12.0, 20.0, math.inf)

CONFIDENT = 0.9
CONFIDENCE_EDGES = (0.0, 0.3, 0.5, 0.7, 0.8, CONFIDENT, 0.95, 1.0)


@dataclass(frozen=True)
class Share:
    """``hits`` of ``cases``."""

    hits: int
    cases: int

    @property
    def value(self) -> float:
        """Hits over cases; NaN without any case."""
        return self.hits / self.cases if self.cases else math.nan

    @property
    def ci95(self) -> tuple[float, float]:
        """Wilson's 95 % score interval of the probability; NaN without any case."""
        if not self.cases:
            return math.nan, math.nan
        interval = binomtest(self.hits, self.cases).proportion_ci(0.95, method="wilson")
        return float(interval.low), float(interval.high)

    def __str__(self) -> str:
        if not self.cases:
            return "no cases"
        low, high = self.ci95
        return f"{100 * self.value:.1f} % ({100 * low:.0f} to {100 * high:.0f} %), {self.hits} of {self.cases}"


@dataclass(frozen=True)
class Range:
    """What has ``low`` <= size in noise, or confidence, < ``high``: its middle, and the share of it that was right."""

    low: float
    high: float
    middle: float
    share: Share


def share_of(flags: Iterable[bool]) -> Share:
    """How many of ``flags`` hold."""
    known = list(flags)
    return Share(sum(known), len(known))


def single_effects(outcomes: Sequence[Outcome], least_in_noise: float = 0.0) -> list[Outcome]:
    """The cases with one effect of at least that size."""
    return [each for each in outcomes if len(each.true) == 1 and each.size_in_noise >= least_in_noise]


def correct_of(outcomes: Sequence[Outcome]) -> Share:
    """The share of correct ones."""
    return share_of(each.correct for each in outcomes)


def confusion(outcomes: Sequence[Outcome]) -> pd.DataFrame:
    """Counts of the cases with at most one effect, by its cause in rows and the first one that was named in columns.

    ``none`` is first and ``unknown`` last, the others go by name.
    """
    pairs = Counter((_first(each.true), _first(each.found)) for each in outcomes if len(each.true) <= 1)
    true, found = _ordered(one for one, _ in pairs), _ordered(name for pair in pairs for name in pair)
    return pd.DataFrame([[pairs[one, other] for other in found] for one in true], true, found)


def detection_by_size(outcomes: Sequence[Outcome], edges: Sequence[float] = SIZE_EDGES) -> tuple[Range, ...]:
    """Of the cases with one effect, the share that was correct, for each range of sizes that has any."""
    return _by_range([(each.size_in_noise, each.correct) for each in single_effects(outcomes)], edges, np.median)


def reliability(outcomes: Sequence[Outcome]) -> tuple[Range, ...]:
    """Of the first causes that were named, the share that was hidden, for each range of confidence that has any."""
    flags = [(sure, right) for each in outcomes for _, sure, right in each.named[:1]]
    return _by_range(flags, CONFIDENCE_EDGES, np.mean)


def _by_range(
    flags: Sequence[tuple[float, bool]], edges: Sequence[float], middle: Callable[[Sequence[float]], Any]
) -> tuple[Range, ...]:
    """The share of ``flags`` in each range of their values that has any; the last range has its end."""
    found = []
    for low, high in pairwise(edges):
        inside = [(value, flag) for value, flag in flags if low <= value < high or value == high == edges[-1]]
        if inside:
            values = [value for value, _ in inside]
            found.append(Range(low, high, float(middle(values)), share_of(flag for _, flag in inside)))
    return tuple(found)


def shares_of(outcomes: Sequence[Outcome]) -> dict[str, Share]:
    """The shares of the benchmark by name.

    Correct ones where one large effect was hidden; those with a step, ``unknown`` included, where nothing was; of two
    effects at once both named, at least one, and nothing at all, where only cause and place count; and right ones among
    the first causes named with a confidence of ``CONFIDENT`` or more.
    """
    pairs = [each for each in outcomes if len(each.true) == 2]
    places = [[{(one.name, one.location) for one in side} for side in (each.true, each.found)] for each in pairs]
    named = [len(true & found) for true, found in places]
    first = [each.named[0] for each in outcomes if each.named]
    return {
        "large_effects": correct_of(single_effects(outcomes, LARGE_IN_NOISE)),
        "false_alarms": share_of(bool(_named(each.found)) for each in outcomes if not _named(each.true)),
        "both": share_of(count == 2 for count in named),
        "at_least_one": share_of(count >= 1 for count in named),
        "nothing": share_of(not _named(each.found) for each in pairs),
        "confident_verdicts": share_of(right for _, sure, right in first if sure >= CONFIDENT),
    }


def by_cause(outcomes: Sequence[Outcome], least_in_noise: float = 0.0) -> dict[str, list[Outcome]]:
    """The cases with one effect of at least that size, by the name of its cause; every hidden cause is there."""
    large = single_effects(outcomes, least_in_noise)
    names = _ordered(each.true[0].name for each in single_effects(outcomes))
    return {name: [each for each in large if each.true[0].name == name] for name in names}


def median_of(values: Iterable[float | None]) -> float:
    """The median of the absolute values that there are; NaN without any."""
    known = [abs(each) for each in values if each is not None and math.isfinite(each)]
    return float(np.median(known)) if known else math.nan


def _named(causes: Sequence[Cause]) -> list[Cause]:
    return [each for each in causes if each.name != NONE]


def _first(causes: Sequence[Cause]) -> str:
    named = _named(causes)
    return named[0].name if named else NONE


def _ordered(names: Iterable[str]) -> tuple[str, ...]:
    return tuple(sorted(set(names), key=lambda name: ({NONE: 0, UNKNOWN: 2}.get(name, 1), name)))
