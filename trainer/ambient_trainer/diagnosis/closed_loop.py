"""Heat that follows the temperatures that it makes, over a whole run at once, as exactly as a sample's step allows.

What effects add to the plain circuit, z, follows

    z[k+1] = E z[k] + Phi0 h[k] + Phi1 h[k+1],

h being their heat over the capacitance. About any course of the nodes, h is a line of z with slope J; then the step is
linear and implicit, (1 - Phi1 J[k+1]) z[k+1] = (E + Phi0 J[k]) z[k] + ..., and all steps' matrices are made together.
A term with a lag adds that to the state.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ambient_trainer.diagnosis.plant import Plant
from ambient_trainer.diagnosis.terms import HeatTerm
from ambient_trainer.lti.lag import lag_weights

Array = NDArray[np.float64]

_NUDGE_K = 1e-3


@dataclass(frozen=True)
class Part:
    """One term's heat: its coefficient times all that weights it, (N,), the term, and where it begins, if it does."""

    weight: Array
    term: HeatTerm
    onset: int | None


def closed_loop(
    plant: Plant, parts: Sequence[Part], nodes: Array, air: Array, bare: Array, along: Array
) -> tuple[Array, Array]:
    """What the heat of ``parts`` adds to ``bare`` (n, N), and ``along`` (c, n, N) with what it answers to that.

    By one of Newton's steps from ``nodes`` (n, N), which were about what all makes: the heat is the line that it is
    there.
    """
    loop = Loop.about(plant, parts, nodes, air)
    if loop is not None:
        added, answer = loop.both(nodes - bare, along)
        return added, along + answer
    heat = np.zeros_like(nodes)
    for each in parts:
        heat += each.weight * each.term.law(nodes, air)
    return np.asarray(plant.V @ plant.modal(plant.W @ (heat / plant.capacitance[:, None]))), along


@dataclass(frozen=True)
class Loop:
    """The linear closed loop about a course of the nodes (n, N); d states, the n nodes' z and the lags of terms."""

    plant: Plant
    parts: tuple[Part, ...]
    nodes_degC: Array
    air_degC: Array
    slopes: tuple[Array, ...]
    """Per part, what each node's temperature does to the law, (N, n, n)."""
    rows: tuple[NDArray[np.intp], ...]
    """Per part, the nodes for which it has a lag."""
    before: Array
    """(N - 1, d, d): what the step's right-hand side takes of the state before."""
    now: Array
    """(N - 1, d, d): what its left-hand side holds of the state that is looked for."""

    @staticmethod
    def about(plant: Plant, parts: Sequence[Part], nodes: Array, air: Array) -> Loop | None:
        """The loop about ``nodes``; None where no heat follows any temperature."""
        slopes = tuple(_slope(each.term, nodes, air) for each in parts)
        if not any(slope.any() for slope in slopes):
            return None
        rows = tuple(
            np.flatnonzero(slope.any(axis=(0, 2))) if each.term.lag_s is not None else np.empty(0, dtype=np.intp)
            for each, slope in zip(parts, slopes)
        )
        n, d = len(nodes), len(nodes) + sum(map(len, rows))
        E, Phi0, Phi1 = _hold(plant)
        J = np.zeros((len(air), n, d))
        first = n
        for each, slope, own in zip(parts, slopes, rows):
            share = each.weight[:, None] / plant.capacitance
            J[:, :, :n] += share[:, :, None] * slope
            J[:, own, range(first, first + len(own))] -= share[:, own]
            first += len(own)
        before, now = np.zeros((2, len(air) - 1, d, d))
        before[:, :n] = Phi0 @ J[:-1]
        before[:, :n, :n] += E
        now[:, :n] = -(Phi1 @ J[1:])
        now[:, range(d), range(d)] += 1.0
        first = n
        for each, slope, own in zip(parts, slopes, rows):
            if len(own):
                mine = np.arange(first, first + len(own))
                kept, early, late = lag_weights(each.term.lag_s or np.inf, plant.period_s)
                before[:, mine, mine] = kept
                before[:, mine, :n] = early * slope[:-1, own]
                now[:, mine, :n] = -late * slope[1:, own]
                if each.onset:
                    before[each.onset - 1, mine] = 0.0
                    now[each.onset - 1, mine, :n] = 0.0
                first += len(own)
        return Loop(plant, tuple(parts), nodes, air, slopes, rows, before, now)

    def answer(self, along: Array) -> Array:
        """What the heat adds to a change ``along`` (c, n, N) of the nodes that something else makes, (c, n, N)."""
        laws = [np.einsum("kij,cjk->cik", slope, along) for slope in self.slopes]
        return self._run(laws, [np.zeros_like(law[:, :, 0]) for law in laws])

    def both(self, z: Array, along: Array) -> tuple[Array, Array]:
        """What the heat adds altogether, (n, N), where the nodes hold ``z`` of it; and as :meth:`answer`."""
        laws, starts = [], []
        for each, slope in zip(self.parts, self.slopes):
            line = each.term.law(self.nodes_degC, self.air_degC) - np.einsum("kij,jk->ik", slope, z)
            answer = np.einsum("kij,cjk->cik", slope, along)
            laws.append(np.concatenate([line[None], answer]))
            start = np.zeros(laws[-1].shape[:2])
            if each.onset:
                start[0] = each.term.apart(len(z), self.air_degC)[:, each.onset]
            starts.append(start)
        found = self._run(laws, starts)
        return found[0], found[1:]

    def _run(self, laws: Sequence[Array], starts: Sequence[Array]) -> Array:
        """z (c, n, N), from laws (c, n, N) beside what z does to them; ``starts`` are memories at an onset, (c, n)."""
        n, N = self.nodes_degC.shape
        count, d = len(laws[0]), self.now.shape[-1]
        drive = np.zeros((N, n, count))
        for each, law in zip(self.parts, laws):
            drive += np.moveaxis(each.weight * law, 0, -1).transpose(1, 0, 2)
        drive /= self.plant.capacitance[:, None]
        _, Phi0, Phi1 = _hold(self.plant)
        forced = np.zeros((N - 1, d, count))
        forced[:, :n] = Phi0 @ drive[:-1] + Phi1 @ drive[1:]
        state = np.zeros((d, count))
        first = n
        for each, law, own, start in zip(self.parts, laws, self.rows, starts):
            if len(own):
                mine = slice(first, first + len(own))
                course = law[:, own].transpose(2, 1, 0)
                _, early, late = lag_weights(each.term.lag_s or np.inf, self.plant.period_s)
                forced[:, mine] = late * course[1:] + early * course[:-1]
                if each.onset:
                    forced[each.onset - 1, mine] = start[:, own].T
                else:
                    state[mine] = course[0]
                first += len(own)
        solved = np.linalg.solve(self.now, np.concatenate([self.before, forced], axis=2))
        steps, forced = np.ascontiguousarray(solved[:, :, :d]), solved[:, :, d:]
        result = np.empty((N, d, count))
        result[0] = state
        for k in range(N - 1):
            state = steps[k] @ state + forced[k]
            result[k + 1] = state
        return np.asarray(result[:, :n].transpose(2, 1, 0))


def _slope(term: HeatTerm, nodes: Array, air: Array) -> Array:
    """What each node's temperature does to a term's law, (N, n, n), by differences."""
    n, N = nodes.shape
    moved = np.broadcast_to(nodes[:, None], (n, n, N)) + _NUDGE_K * np.eye(n)[:, :, None]
    change = term.law(moved, np.broadcast_to(air, (n, N))) - term.law(nodes, air)[:, None]
    return np.asarray(change.transpose(2, 0, 1) / _NUDGE_K)


def _hold(plant: Plant) -> tuple[Array, Array, Array]:
    a, now, later = plant.modal_weights()
    E, Phi0, Phi1 = ((plant.V * each) @ plant.W for each in (a, now, later))
    return E, Phi0, Phi1
