"""Stepwise search over edges: from each start the best neighbour, as long as one lowers the held-out error by 1 %.

Then the best loses edges again, as many as leave its error within 1 %.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from ambient_trainer.selection.topology import Topology, initial_topologies, neighbours, without

Score = Callable[[Sequence[Topology]], Sequence[float]]
"""The held-out error of each topology in degC."""

_GAIN = 0.01
"""Chosen: less is within what another seed of the same run changes."""
_PRUNINGS = 8


def best_topology(sensors: Sequence[str], most_states: int, score: Score) -> Topology:
    """The topology of ``sensors`` that the steps lead to, less the edges that it can do without."""
    tried: dict[Topology, float] = {}

    def noted(topologies: Sequence[Topology]) -> Sequence[float]:
        errors = score(topologies)
        tried.update(zip(topologies, errors))
        return errors

    for start in initial_topologies(sensors, most_states):
        _descend(start, most_states, noted)
    limit = (1 + _GAIN) * min(tried.values())
    return _with_fewer_edges(min(tried, key=lambda each: (tried[each], len(each.edges))), noted, limit)


def _with_fewer_edges(topology: Topology, score: Score, limit_degC: float) -> Topology:
    """The topology less as many edges as the limit allows, those first that cost least by themselves."""
    alone = [(edge, less) for edge in topology.edges for less in [without(topology, [edge])] if less.complete]
    order = [edge for _, (edge, _) in sorted(zip(score([less for _, less in alone]), alone))]
    counts = sorted({round(each) for each in np.linspace(1, len(order), min(len(order), _PRUNINGS))})
    usable = [less for count in counts if (less := without(topology, order[:count])).complete]
    good = [each for each, error in zip(usable, score(usable)) if error <= limit_degC]
    return good[-1] if good else topology


def _descend(start: Topology, most_states: int, score: Score) -> None:
    error, here = score([start])[0], start
    while around := neighbours(here, most_states):
        least, best = min(zip(score(around), range(len(around))))
        if least >= (1 - _GAIN) * error:
            return
        error, here = least, around[best]
