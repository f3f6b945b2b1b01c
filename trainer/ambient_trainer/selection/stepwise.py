"""Stepwise over edges: from each start the best neighbour, as long as one lowers the held-out error by a hundredth.

Then the best loses edges again, as many as leave its error within a hundredth.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from ambient_trainer.selection.wiring import Wiring, neighbours, starting_wirings, without

Score = Callable[[Sequence[Wiring]], Sequence[float]]
"""The held-out error of each wiring in degC."""

_HUNDREDTH = 0.01
_THINNINGS = 8


def best_wiring(sensors: Sequence[str], most_states: int, score: Score) -> Wiring:
    """The wiring of ``sensors`` that the steps lead to, less the edges that it can do without."""
    tried: dict[Wiring, float] = {}

    def noted(wirings: Sequence[Wiring]) -> Sequence[float]:
        errors = score(wirings)
        tried.update(zip(wirings, errors))
        return errors

    for start in starting_wirings(sensors, most_states):
        _climb(start, most_states, noted)
    limit = (1 + _HUNDREDTH) * min(tried.values())
    return _thinned(min(tried, key=lambda each: (tried[each], len(each.edges))), noted, limit)


def _thinned(wiring: Wiring, score: Score, limit_degC: float) -> Wiring:
    """The wiring less as many edges as the limit allows, those first that cost least by themselves."""
    alone = [(edge, less) for edge in wiring.edges for less in [without(wiring, [edge])] if less.complete]
    order = [edge for _, (edge, _) in sorted(zip(score([less for _, less in alone]), alone))]
    counts = sorted({round(each) for each in np.linspace(1, len(order), min(len(order), _THINNINGS))})
    nested = [without(wiring, order[:count]) for count in counts]
    usable = [each for each in nested if each.complete]
    good = [each for each, error in zip(usable, score(usable)) if error <= limit_degC]
    return good[-1] if good else wiring


def _climb(start: Wiring, most_states: int, score: Score) -> None:
    error, here = score([start])[0], start
    while around := neighbours(here, most_states):
        found = min(zip(score(around), range(len(around))))
        if found[0] >= (1 - _HUNDREDTH) * error:
            return
        error, here = found[0], around[found[1]]
