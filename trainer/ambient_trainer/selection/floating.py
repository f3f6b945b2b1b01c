"""Floating forward selection: grown sensor by sensor, every set is swapped and thinned until nothing gains.

Plain forward selection keeps its first choices for ever. Here a beam of good sets grows; then any one member may be
swapped for any other sensor, round after round; and where a grown set less one member beats the best smaller set, the
search goes back to that size (floating search: Pudil, Novovicova and Kittler 1994, Pattern Recognition Letters 15).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

from ambient_trainer.selection.grams import Sensors

Score = Callable[[Sequence[Sensors]], Sequence[float]]
"""The held-out error of each candidate; all of one size."""

_BEAM = 6
_ROUNDING = 1e-9


def best_sets(allowed: Sequence[int], most: int, score: Score) -> list[Sensors]:
    """The best set found of every size from 1 to ``most``, or to as many as are allowed."""
    beams: dict[int, list[tuple[float, Sensors]]] = {0: [(0.0, ())]}
    size, last = 1, min(most, len(allowed))
    while size <= last:
        pool = _grown([each for _, each in beams[size - 1]], allowed)
        pool |= {each for _, each in beams.get(size, [])}
        beams[size] = _swapped(_ranked(pool, score), allowed, score)
        fewer = _ranked(thinned([each for _, each in beams[size]]), score) if size > 1 else []
        if fewer and fewer[0][0] < beams[size - 1][0][0] - _ROUNDING:
            beams[size - 1] = sorted(set(fewer + beams[size - 1]))[:_BEAM]
            size -= 1
        else:
            size += 1
    return [beams[each][0][1] for each in range(1, last + 1)]


def swaps(members: Sensors, allowed: Sequence[int]) -> list[tuple[int, int, Sensors]]:
    """Every (member out, sensor in, resulting set)."""
    others = [each for each in allowed if each not in members]
    return [
        (out, new, tuple(sorted((*(each for each in members if each != out), new))))
        for out in members
        for new in others
    ]


def thinned(sets: Iterable[Sensors]) -> set[Sensors]:
    """The sets less one member each."""
    return {tuple(each for each in members if each != out) for members in sets for out in members}


def _grown(sets: Iterable[Sensors], allowed: Sequence[int]) -> set[Sensors]:
    return {tuple(sorted((*members, new))) for members in sets for new in allowed if new not in members}


def _swapped(beam: list[tuple[float, Sensors]], allowed: Sequence[int], score: Score) -> list[tuple[float, Sensors]]:
    """The beam after rounds of swaps, until its best gains no more."""
    while True:
        pool = {swapped for _, members in beam for _, _, swapped in swaps(members, allowed)}
        better = _ranked(pool | {members for _, members in beam}, score)
        if better[0][0] >= beam[0][0] - _ROUNDING:
            return better
        beam = better


def _ranked(sets: Iterable[Sensors], score: Score) -> list[tuple[float, Sensors]]:
    """The best of ``sets``; between equals the one that was logged first, so that every run finds the same."""
    ordered = sorted(sets)
    return sorted(zip(score(ordered), ordered))[:_BEAM]
