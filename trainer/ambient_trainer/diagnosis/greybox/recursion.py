"""Recursions from sample to sample, compiled: modes of linear networks, and what nonlinear heat adds to them.

Shapes: P lanes, n modes, N samples, k active nodes, m pairs of them, q losses by a power, r changes of phase.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from ambient_trainer.data.trace import Array

_STEEPEST = 5.0
"""A loss grows by at most exp(5)."""


class Terms(NamedTuple):
    """Heat into k active nodes that follows from their temperatures.

    ``known`` and ``fall`` (P, k, N): heat at 0 degC, and by how much less per K. Between ``pair_nodes`` (m, 2) are
    conductances ``pair_G`` (P, m, N). Node ``power_node`` (q,) loses
    G |d/d0|^p d to the air at ``air_degC`` (q, N) instead of G d: ``power_G``, ``power`` and ``typical`` (P, q).
    Between ``phase_nodes`` (r, 2) flows ``phase_G`` (P, r) times what lies below ``melting`` (r,), in a body whose heat
    of fusion is ``fusion`` (P, r); ``sign`` (r,) is -1 where it begins solid.
    """

    known: Array
    fall: Array
    pair_nodes: Any
    pair_G: Array
    power_node: Any
    air_degC: Array
    power_G: Array
    power: Array
    typical: Array
    least: float
    phase_nodes: Any
    phase_G: Array
    fusion: Array
    melting: Array
    sign: Array


def _compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    """``function`` compiled at its first call; kept on disk where that can be written."""
    try:
        return njit(function, cache=True, error_model="numpy")
    except RuntimeError:
        return njit(function, error_model="numpy")


@_compiled
def filtered(drive, kept, before, now, first):  # type: ignore[no-untyped-def]
    """Modes (P, n, N) from ``first`` (P, n), by x[i] = kept x[i-1] + before u[i-1] + now u[i]."""
    modes = np.empty_like(drive)
    for lane in range(drive.shape[0]):
        for mode in range(drive.shape[1]):
            a, b, c = kept[lane, mode], before[lane, mode], now[lane, mode]
            state = first[lane, mode]
            modes[lane, mode, 0] = state
            for index in range(1, drive.shape[2]):
                state = a * state + b * drive[lane, mode, index - 1] + c * drive[lane, mode, index]
                modes[lane, mode, index] = state
    return modes


@_compiled
def _heat(degC, lane, index, terms, heat):  # type: ignore[no-untyped-def]
    """The heat (k,) of one lane at one sample, into ``heat``."""
    for node in range(len(degC)):
        heat[node] = terms.known[lane, node, index] - terms.fall[lane, node, index] * degC[node]
    for term in range(len(terms.pair_nodes)):
        one, other = terms.pair_nodes[term]
        flow = terms.pair_G[lane, term, index] * (degC[other] - degC[one])
        heat[one] += flow
        heat[other] -= flow
    for term in range(len(terms.power_node)):
        node = terms.power_node[term]
        away = terms.air_degC[term, index] - degC[node]
        share = terms.power[lane, term] * np.log(max(abs(away) / terms.typical[lane, term], terms.least))
        heat[node] += terms.power_G[lane, term] * np.expm1(min(max(share, -_STEEPEST), _STEEPEST)) * away
    for term in range(len(terms.phase_nodes)):
        node, body = terms.phase_nodes[term]
        sign = terms.sign[term]
        below = min(max(sign * (terms.melting[term] - degC[body]), 0.0), terms.fusion[lane, term])
        heat[node] += sign * terms.phase_G[lane, term] * below
        heat[body] -= sign * terms.phase_G[lane, term] * below


@_compiled
def _driven(into, lane, heat, drive):  # type: ignore[no-untyped-def]
    """What ``heat`` (k,) does to each mode of a lane, into ``drive`` (n,)."""
    for mode in range(len(drive)):
        drive[mode] = 0.0
        for node in range(len(heat)):
            drive[mode] += into[lane, mode, node] * heat[node]


@_compiled
def heat_along(degC, terms):  # type: ignore[no-untyped-def]
    """The heat (P, k, N) of all lanes along temperatures (k, N)."""
    lanes, nodes, samples = terms.known.shape
    result, heat = np.empty((lanes, nodes, samples)), np.empty(nodes)
    for lane in range(lanes):
        for index in range(samples):
            _heat(degC[:, index], lane, index, terms, heat)
            result[lane, :, index] = heat
    return result


@_compiled
def answered(along, kept, before, now, into, out, terms):  # type: ignore[no-untyped-def]
    """What the terms add to the modes (P, n, N), beside active nodes at ``along`` (P, k, N) without them.

    Exponential Runge-Kutta of order 2: predicted with the heat of the sample before, corrected with what follows.
    ``into`` (P, n, k) takes heat to modes, ``out`` (P, k, n) modes to nodes.
    """
    lanes, nodes, samples = along.shape
    count = kept.shape[1]
    modes = np.zeros((lanes, count, samples))
    degC, heat = np.empty(nodes), np.empty(nodes)
    last, trial, predicted = np.empty(count), np.empty(count), np.empty(count)
    for lane in range(lanes):
        degC[:] = along[lane, :, 0]
        _heat(degC, lane, 0, terms, heat)
        _driven(into, lane, heat, last)
        for index in range(1, samples):
            for mode in range(count):
                both = before[lane, mode] + now[lane, mode]
                trial[mode] = kept[lane, mode] * modes[lane, mode, index - 1] + both * last[mode]
            for node in range(nodes):
                value = along[lane, node, index]
                for mode in range(count):
                    value += out[lane, node, mode] * trial[mode]
                degC[node] = value
            _heat(degC, lane, index, terms, heat)
            _driven(into, lane, heat, predicted)
            for mode in range(count):
                modes[lane, mode, index] = trial[mode] + now[lane, mode] * (predicted[mode] - last[mode])
            for node in range(nodes):
                value = along[lane, node, index]
                for mode in range(count):
                    value += out[lane, node, mode] * modes[lane, mode, index]
                degC[node] = value
            _heat(degC, lane, index, terms, heat)
            _driven(into, lane, heat, last)
    return modes
