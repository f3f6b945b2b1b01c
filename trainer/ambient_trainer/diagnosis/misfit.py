"""Misfit of a circuit: residuals of its simulation, and the unmeasured heat that would explain them.

Whatever the circuit's own flows are, what is measured less what is simulated, r, obeys C dr/dt = C A r + q, where q is
the heat that the circuit does not know: it is read off at each node with a sensor, as C dr/dt less the flows that r
drives. Nodes without one follow those that have one. Steps in the inputs, which both share, do not blur it, and what a
known-good record showed the circuit to need besides is in the simulation, hence not in q.

dr/dt is the slope of a straight line through a window of ``heat_window_samples``, one for all nodes.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.signal import lsim, savgol_filter

from ambient_model.trace import REFERENCE
from ambient_trainer.circuits.circuit import AMBIENT, Circuit
from ambient_trainer.data.trace import Array
from ambient_trainer.diagnosis.greybox.network import Network
from ambient_trainer.diagnosis.record import Record, bridged
from ambient_trainer.diagnosis.residual_tests import residual_tests
from ambient_trainer.diagnosis.result import Misfit

NOISE_SHARE = 0.2
"""The window is the shortest in which noise makes no more than this share of the standard deviation of all heat."""
_SHORTEST, _LONGEST_SHARE, _LONGER = 5, 0.05, 1.3
_NO_AIR_DEGC = 300.0
"""No air is so far off as a node asks for that hardly meets it."""


class _Nodes(NamedTuple):
    """A linear network of n nodes, the ``seen`` first ones with a sensor: dx/dt = ``A`` (n, n) x without other heat.

    Heat capacities ``C`` in J/K and conductances ``to_air`` in W/K are (n,).
    """

    A: Array
    C: Array
    to_air: Array
    seen: int
    period_s: float

    @staticmethod
    def of(network: Network) -> _Nodes:
        """Of the first lane."""
        between, outside, C = network.between[0], network.to_boundary[0], network.capacitance[0]
        A = (between - np.diag(between.sum(axis=1) + outside.sum(axis=1))) / C[:, None]
        to_air = outside[:, network.boundary(AMBIENT)] if AMBIENT in network.boundaries else np.zeros(len(A))
        order = np.append(network.reads, np.setdiff1d(np.arange(len(A)), network.reads))
        period_s = network.period_s * network.every
        return _Nodes(A[np.ix_(order, order)], C[order], to_air[order], len(network.reads), period_s)


def misfit_of(circuit: Circuit, network: Network, record: Record, simulated_degC: Array) -> Misfit:
    """What a forward ``circuit`` gets wrong, on the record's own times.

    ``network`` is that of the circuit, ``simulated_degC`` (s, N) what its sensors read by it.
    """
    nodes, residual = _Nodes.of(network), record.sensors - simulated_degC
    # with straight lines over gaps
    left, enough = np.array([bridged(row) for row in residual]), record.samples >= _SHORTEST
    window = heat_window_samples(nodes, left) if enough else 0
    heat_W = np.where(np.isnan(residual), np.nan, _heat_W(nodes, left, window) if enough else np.nan)
    in_W = in_watts(circuit)
    heat = heat_W if in_W else heat_W / nodes.C[: nodes.seen, None]
    sensors = tuple(output.name for output in circuit.outputs)
    air = record.inputs[circuit.inputs.index(REFERENCE)] if REFERENCE in circuit.inputs else None
    tests = residual_tests(
        record.time_s,
        residual,
        heat,
        sensors,
        {name: row for name, row in record.signals.items() if not name.endswith("_degC")},
        np.full(record.samples, np.nan) if air is None else air,
        record.sensors,
    )
    unit, error = "W" if in_W else "K/s", _ambient_error_degC(nodes, residual, left, window) if enough else None
    return Misfit(sensors, record.sensors, simulated_degC, heat, unit, tests, error)


def in_watts(circuit: Circuit) -> bool:
    """Whether something fixed sets the scale of heat: temperatures alone determine only heat over capacitance."""
    fixed = {each.name: each.initial for each in circuit.parameters if not each.free}
    # a share that was given in watts for a load does as well; the default of one does for a power only
    shares = [each.share for each in circuit.sources if each.signal.endswith("_W") or fixed.get(each.share) != 1.0]
    names = [*shares, *(node.capacitance for node in circuit.states), *(each.resistance for each in circuit.edges)]
    return any(name in fixed for name in names)


def heat_window_samples(nodes: _Nodes, left: Array) -> int:
    """Over how many samples the heat that explains ``left`` (s, N) is smoothed: an odd number."""
    noise_degC = _white_noise_degC(left)
    longest = max(_SHORTEST, int(_LONGEST_SHARE * left.shape[1]) | 1)
    window = _SHORTEST
    while window < longest:
        # the standard error of the slope of a line through so many evenly spaced points
        slope_K_s = noise_degC * np.sqrt(12.0 / (window**3 - window)) / nodes.period_s
        heat = _heat_W(nodes, left, window)
        if np.sum((nodes.C[: nodes.seen] * slope_K_s) ** 2) <= NOISE_SHARE**2 * np.sum(np.var(heat, axis=1)):
            break
        window = min(longest, int(_LONGER * window) // 2 * 2 + 1)
    return window


def _heat_W(nodes: _Nodes, left: Array, window: int) -> Array:
    """The heat that no modelled flow accounts for, at each sensor's node, (s, N): C dr/dt less the flows that r drives,
    for r = ``left`` (s, N) there. Its scale is that of the capacitances: watts only where those are."""
    heat, s = _heat_among_sensors_W(nodes, left, window), nodes.seen
    if len(nodes.A) > s:
        hidden, drive, from_hidden = nodes.A[s:, s:], nodes.A[s:, :s] @ left, nodes.C[:s, None] * nodes.A[:s, s:]
        follows = _followed(hidden, drive, nodes.period_s, np.zeros(len(hidden)))
        heat -= from_hidden @ savgol_filter(follows, window, 1, axis=1)
        # where a hidden node began is not known: such that it leaves the least heat
        starts = [from_hidden @ _followed(hidden, 0 * drive, nodes.period_s, one) for one in np.eye(len(hidden))]
        columns = np.array([each.ravel() for each in starts]).T
        heat -= (columns @ np.linalg.lstsq(columns, heat.ravel(), rcond=1e-6)[0]).reshape(heat.shape)
    return _in_whole_windows(heat, window)


def _heat_among_sensors_W(nodes: _Nodes, left: Array, window: int) -> Array:
    """As :func:`_heat_W`, if r were zero wherever there is no sensor; at the ends without a whole window."""
    slope = savgol_filter(left, window, 1, deriv=1, delta=nodes.period_s, axis=1)
    level, C = savgol_filter(left, window, 1, axis=1), nodes.C[: nodes.seen, None]
    return np.asarray(C * slope - C * nodes.A[: nodes.seen, : nodes.seen] @ level)


def _in_whole_windows(rows: Array, window: int) -> Array:
    """``rows`` (..., N), at the ends held at what the first and the last whole window give."""
    half = window // 2
    kept = np.clip(np.arange(rows.shape[-1]), half, rows.shape[-1] - 1 - half)
    return np.asarray(rows[..., kept])


def _ambient_error_degC(nodes: _Nodes, residual: Array, left: Array, window: int) -> Array | None:
    """True less estimate, (N,), of the ambient that balances the measured nodes which are joined to it; NaN in gaps.

    Each asks for q / G more than there was; together, weighted by their conductances G, for sum q / sum G. What a node
    without a sensor does follows from the sensors and that same ambient, from equilibrium. None where no measured node
    is joined to the ambient, or so loosely that no air would do, or those without a sensor make it run away.
    """
    s, joined, total = nodes.seen, nodes.to_air[: nodes.seen] > 0, nodes.to_air[: nodes.seen].sum()
    if not joined.any():
        return None
    excess = _heat_among_sensors_W(nodes, left, window)[joined].sum(axis=0) / total
    if len(nodes.A) > s:
        inflow = (nodes.C[:s, None] * nodes.A[:s, s:])[joined].sum(axis=0) / total
        by_air = nodes.to_air[s:] / nodes.C[s:]
        A = nodes.A[s:, s:] - np.outer(by_air, inflow)
        if np.linalg.eigvals(A).real.max() >= 0:
            return None
        drive = nodes.A[s:, :s] @ left + np.outer(by_air, excess)
        start = np.asarray(-np.linalg.solve(A, drive[:, 0]), dtype=np.float64)
        excess = excess - inflow @ _followed(A, drive, nodes.period_s, start)
    known = ~np.isnan(residual[joined]).any(axis=0)
    error = np.where(known, -_in_whole_windows(excess, window), np.nan)
    return None if np.nanmax(np.abs(error), initial=0.0) > _NO_AIR_DEGC else error


def _followed(A: Array, drive: Array, period_s: float, start: Array) -> Array:
    """x (k, N) with dx/dt = A x + ``drive`` (k, N)."""
    unit, time_s = np.eye(len(A)), period_s * np.arange(drive.shape[1])
    return np.asarray(lsim((A, unit, unit, 0 * unit), drive.T, time_s, start)[1]).reshape(-1, len(A)).T


def _white_noise_degC(rows: Array) -> Array:
    """Per row of (s, N) the deviation of what is in it from one sample to the next, by its second differences."""
    return np.asarray(np.abs(np.diff(rows, 2, axis=1)).mean(axis=1) * np.sqrt(np.pi / 2.0) / np.sqrt(6.0))
