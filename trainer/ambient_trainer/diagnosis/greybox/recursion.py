"""Compiled recursions over samples: modes of linear networks, and their response to nonlinear heat.

Shapes: P lanes, n modes, N samples, k active nodes, m pairs of them, q losses by a power, r changes of phase.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from ambient_trainer.data.trace import Array

_STEEPEST, _SMALLEST = 5.0, 0.02
"""A loss grows by at most exp(5); below that share of the typical difference its power is taken there."""


class Terms(NamedTuple):
    """Heat into k active nodes that follows from their temperatures.

    ``known`` and ``fall`` (P, k, N): heat at 0 degC, and by how much less per K. Between ``pair_nodes`` (m, 2) are
    conductances ``pair_G`` (m, P, N). Node ``power_node`` (q,) loses G |d/d0|^p d to the air at ``air_degC`` (q, N)
    instead of G d; ``power_G`` (q, P, N) is G, ``power`` (q, 2, P) holds d0 and p. Between ``phase_nodes`` (r, 2), a
    node and a body, flows G times what lies below the melting point; ``phase`` (r, 4, P) holds G, the heat of fusion,
    the melting point, and -1 where the body begins solid, else 1.
    """

    known: Array
    fall: Array
    pair_nodes: Any
    pair_G: Array
    power_node: Any
    air_degC: Array
    power_G: Array
    power: Array
    phase_nodes: Any
    phase: Array


def _compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    """``function`` compiled at its first call; kept on disk where that can be written."""
    try:
        return njit(function, cache=True, error_model="numpy")
    except RuntimeError:
        return njit(function, error_model="numpy")


@_compiled
def filtered(drive, kept, before, now, first):  # type: ignore[no-untyped-def]
    """Modes x (P, n, N) from ``first`` (P, n), in place of their ``drive`` u.

    x[i] = kept x[i-1] + before u[i-1] + now u[i].
    """
    lanes, count, samples = drive.shape
    state, last = np.empty(count), np.empty(count)
    for lane in range(lanes):
        state[:] = first[lane]
        last[:] = drive[lane, :, 0]
        drive[lane, :, 0] = state
        # mode by mode each sample would wait for the one before
        for index in range(1, samples):
            for mode in range(count):
                forcing = drive[lane, mode, index]
                forced = before[lane, mode] * last[mode] + now[lane, mode] * forcing
                state[mode] = kept[lane, mode] * state[mode] + forced
                drive[lane, mode, index], last[mode] = state[mode], forcing
    return drive


@_compiled
def nonlinear_response(along, kept, before, now, into, out, terms):  # type: ignore[no-untyped-def]
    """Response of the modes (P, n, N) to nonlinear terms; ``along`` (P, k, N) are the active nodes without them.

    Exponential Runge-Kutta of order 2: predicted with the heat of the sample before, corrected with what follows.
    ``into`` (P, n, k) takes heat to modes, ``out`` (P, k, n) modes to nodes. All is one loop: a call that is given the
    terms costs ten times what it computes.
    """
    lanes, nodes, samples = along.shape
    count = kept.shape[1]
    modes = np.zeros((lanes, count, samples))
    degC, heat = np.empty(nodes), np.empty(nodes)
    state, drive, last = np.empty(count), np.empty(count), np.empty(count)
    known, fall, pair_nodes, pair_G, power_node, air_degC, power_G, power, phase_nodes, phase = terms
    for lane in range(lanes):
        state[:] = 0.0
        # a run begins with the heat of its first sample
        for step in range(1, 2 * samples):
            index, corrected = step // 2, step % 2
            if not corrected:
                for mode in range(count):
                    both = before[lane, mode] + now[lane, mode]
                    state[mode] = kept[lane, mode] * state[mode] + both * last[mode]
            for node in range(nodes):
                value = along[lane, node, index]
                for mode in range(count):
                    value += out[lane, node, mode] * state[mode]
                degC[node] = value
                heat[node] = known[lane, node, index] - fall[lane, node, index] * value
            for term in range(len(pair_nodes)):
                one, other = pair_nodes[term, 0], pair_nodes[term, 1]
                flow = pair_G[term, lane, index] * (degC[other] - degC[one])
                heat[one] += flow
                heat[other] -= flow
            for term in range(len(power_node)):
                node = power_node[term]
                away = air_degC[term, index] - degC[node]
                share = power[term, 1, lane] * np.log(max(abs(away) / power[term, 0, lane], _SMALLEST))
                heat[node] += power_G[term, lane, index] * np.expm1(min(max(share, -_STEEPEST), _STEEPEST)) * away
            for term in range(len(phase_nodes)):
                node, body = phase_nodes[term, 0], phase_nodes[term, 1]
                sign = phase[term, 3, lane]
                below = min(max(sign * (phase[term, 2, lane] - degC[body]), 0.0), phase[term, 1, lane])
                flow = sign * phase[term, 0, lane] * below
                heat[node] += flow
                heat[body] -= flow
            for mode in range(count):
                drive[mode] = 0.0
                for node in range(nodes):
                    drive[mode] += into[lane, mode, node] * heat[node]
                if corrected:
                    modes[lane, mode, index] = state[mode]
                    last[mode] = drive[mode]
                else:
                    state[mode] += now[lane, mode] * (drive[mode] - last[mode])
    return modes


def heat_along_trajectory(degC: Array, terms: Terms) -> Array:
    """Heat (P, k, N) of all lanes along temperatures (k, N): each node is a mode that responds at once."""
    lanes, nodes, samples = terms.known.shape
    along = np.repeat(degC[None], lanes, axis=0)
    at_once, never, itself = np.ones((lanes, nodes)), np.zeros((lanes, nodes)), np.tile(np.eye(nodes), (lanes, 1, 1))
    result = nonlinear_response(along, never, never, at_once, itself, np.zeros_like(itself), terms)
    # modes begin at nothing, whatever the first sample's heat
    result[:, :, 0] = result[:, :, min(1, samples - 1)]
    return np.asarray(result)
