"""What a benchmark's outcomes amount to: counts, and shares with Wilson's interval, which holds near 0 and 1 too."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ambient_studies.discovery.outcome import Outcome
from ambient_trainer.diagnosis.result import NONE, UNKNOWN, Cause

LARGE_IN_NOISE = 5.0
"""From this size on an effect ought to be found."""
SIZE_EDGES = (0.0, 0.5, 1.0, 2.0, 3.0, 5.0, 8.0, 12.0, 20.0, math.inf)
_Z95 = 1.959963984540054


@dataclass(frozen=True)
class Share:
    """``hits`` of ``cases``, and the 95 % interval (Wilson's) of the probability; NaN without any case."""

    hits: int
    cases: int

    @property
    def value(self) -> float:
        """Hits over cases."""
        return self.hits / self.cases if self.cases else math.nan

    @property
    def ci95(self) -> tuple[float, float]:
        """Wilson's score interval."""
        if not self.cases:
            return math.nan, math.nan
        n, p, z = self.cases, self.value, _Z95
        centre = (p + z * z / (2 * n)) / (1 + z * z / n)
        half = z / (1 + z * z / n) * math.sqrt(p * (1 - p) / n + z * z / (4 * n * n))
        # the ends are exact at 0 and 1, where rounding would not be
        return (0.0 if not self.hits else centre - half, 1.0 if self.hits == n else centre + half)

    def __str__(self) -> str:
        if not self.cases:
            return "no cases"
        low, high = self.ci95
        return f"{100 * self.value:.1f} % ({100 * low:.0f} to {100 * high:.0f} %), {self.hits} of {self.cases}"


@dataclass(frozen=True)
class Confusion:
    """``counts`` (true, found) of the cases with at most one effect, by the name of the cause: the first one found."""

    true: tuple[str, ...]
    found: tuple[str, ...]
    counts: NDArray[np.int64]


@dataclass(frozen=True)
class Detection:
    """The cases whose effect has ``low`` <= size in noise < ``high``: how many were named with their location."""

    low: float
    high: float
    middle: float
    """The median size of the cases."""
    share: Share


@dataclass(frozen=True)
class Pairs:
    """Cases of two effects at once: both named with their location, at least one, and nothing at all."""

    both: Share
    one: Share
    nothing: Share


def correct_of(outcomes: Sequence[Outcome]) -> Share:
    """The share of correct ones."""
    return Share(sum(each.correct for each in outcomes), len(outcomes))


def confusion(outcomes: Sequence[Outcome]) -> Confusion:
    """What was found against what was hidden: ``none`` first and ``unknown`` last, the others by name."""
    single = [each for each in outcomes if len(each.true) <= 1]
    pairs = [(_first(each.true), _first(each.found)) for each in single]
    true = _ordered(one for one, _ in pairs)
    found = _ordered(name for pair in pairs for name in pair)
    counts = np.zeros((len(true), len(found)), dtype=np.int64)
    for one, other in pairs:
        counts[true.index(one), found.index(other)] += 1
    return Confusion(true, found, counts)


def detection_by_size(outcomes: Sequence[Outcome], edges: Sequence[float] = SIZE_EDGES) -> tuple[Detection, ...]:
    """Of the cases with one effect, the share that was correct, for each range of sizes that has any."""
    single = [each for each in outcomes if len(each.true) == 1]
    found = []
    for low, high in pairwise(edges):
        inside = [each for each in single if low <= each.size_in_noise < high]
        if inside:
            middle = float(np.median([each.size_in_noise for each in inside]))
            found.append(Detection(low, high, middle, correct_of(inside)))
    return tuple(found)


def large_effects(outcomes: Sequence[Outcome]) -> Share:
    """The share of correct ones where one effect of at least ``LARGE_IN_NOISE`` was hidden."""
    return correct_of([each for each in outcomes if len(each.true) == 1 and each.size_in_noise >= LARGE_IN_NOISE])


def false_alarms(outcomes: Sequence[Outcome]) -> Share:
    """The share of cases without any effect in which something was found, ``unknown`` included."""
    idle = [each for each in outcomes if not _named(each.true)]
    return Share(sum(bool(_named(each.found)) for each in idle), len(idle))


def pairs_found(outcomes: Sequence[Outcome]) -> Pairs:
    """The cases of two effects at once."""
    both = [each for each in outcomes if len(each.true) == 2]
    # a second effect's signal is a matter of its own: cause and place are what is asked for
    named = [len({_place(cause) for cause in each.true} & {_place(cause) for cause in each.found}) for each in both]
    cases = len(both)
    return Pairs(
        Share(sum(count == 2 for count in named), cases),
        Share(sum(count >= 1 for count in named), cases),
        Share(sum(not _named(each.found) for each in both), cases),
    )


def by_cause(outcomes: Sequence[Outcome], least_in_noise: float = 0.0) -> dict[str, list[Outcome]]:
    """The cases with one effect of at least that size, by the name of its cause."""
    names = _ordered(each.true[0].name for each in outcomes if len(each.true) == 1)
    return {
        name: [
            each
            for each in outcomes
            if len(each.true) == 1 and each.true[0].name == name and each.size_in_noise >= least_in_noise
        ]
        for name in names
    }


def median_of(values: Iterable[float | None]) -> float:
    """The median of the absolute values that there are; NaN without any."""
    known = [abs(each) for each in values if each is not None and math.isfinite(each)]
    return float(np.median(known)) if known else math.nan


def _named(causes: Sequence[Cause]) -> list[Cause]:
    return [each for each in causes if each.name != NONE]


def _first(causes: Sequence[Cause]) -> str:
    named = _named(causes)
    return named[0].name if named else NONE


def _place(cause: Cause) -> tuple[str, str | None]:
    return cause.name, cause.location


def _ordered(names: Iterable[str]) -> tuple[str, ...]:
    def rank(name: str) -> tuple[int, str]:
        return {NONE: 0, UNKNOWN: 2}.get(name, 1), name

    return tuple(sorted(set(names), key=rank))
