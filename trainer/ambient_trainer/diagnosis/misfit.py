"""The misfit of a circuit: where the simulation and the sensors part, and the heat that would explain it.

Whatever the circuit's own flows are, what is measured less what is simulated, r, obeys C dr/dt = C A r + q, where q is
the heat that the circuit does not know: it is read off at each node with a sensor, as C dr/dt less the flows that r
drives. Nodes without one follow those that have one. Steps in the inputs, which both share, do not blur it, and what a
known-good record showed the circuit to need besides is in the simulation, hence not in q.

dr/dt is the slope of a straight line through a window of ``heat_window_samples``, one for all nodes.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lsim, savgol_filter

from ambient_model.trace import REFERENCE
from ambient_trainer.diagnosis.plant import Plant
from ambient_trainer.diagnosis.record import bridged
from ambient_trainer.diagnosis.residual_tests import residual_tests
from ambient_trainer.diagnosis.result import Misfit
from ambient_trainer.diagnosis.setting import heat_in_watts
from ambient_trainer.diagnosis.view import View, conductances_to_ambient

Array = NDArray[np.float64]

NOISE_SHARE = 0.2
"""The window is the shortest in which noise makes no more than this share of the standard deviation of all heat."""
_SHORTEST, _LONGEST_SHARE, _LONGER = 5, 0.05, 1.3


def misfit_of(view: View) -> Misfit:
    """What the model behind ``view`` gets wrong, on the record's own times."""
    plant, record = view.plant, view.record
    heat_W = residual_heat_W(view)
    in_W = heat_in_watts(plant.circuit)
    heat = heat_W if in_W else heat_W / plant.capacitance[plant.reads, None]
    has_ambient = REFERENCE in plant.circuit.inputs
    tests = residual_tests(
        record.time_s,
        view.residual_degC,
        heat,
        plant.sensors,
        view.signals,
        view.ambient_degC if has_ambient else np.full(record.samples, np.nan),
        record.sensors,
    )
    return Misfit(
        plant.sensors,
        record.sensors,
        view.simulated_degC,
        heat,
        "W" if in_W else "K/s",
        tests,
        _ambient_error_degC(view),
    )


def residual_heat_W(view: View) -> Array:
    """The heat that no modelled flow accounts for, at each sensor's node, (s, N); NaN where nothing was measured.

    Its scale is that of the capacitances: watts only where those are.
    """
    if view.record.samples < _SHORTEST:
        return np.full_like(view.residual_degC, np.nan)
    known = ~np.isnan(view.residual_degC)
    heat = _heat_W(view.plant, _left(view), heat_window_samples(view))
    return np.where(known, heat, np.nan)


def heat_window_samples(view: View) -> int:
    """Over how many samples the heat is smoothed: an odd number."""
    left = _left(view)
    noise_degC = _white_noise_degC(left)
    capacitance = view.plant.capacitance[view.plant.reads]
    longest = max(_SHORTEST, int(_LONGEST_SHARE * left.shape[1]) | 1)
    window = _SHORTEST
    while window < longest:
        # the standard error of the slope of a line through so many evenly spaced points
        slope_K_s = noise_degC * np.sqrt(12.0 / (window**3 - window)) / view.plant.period_s
        heat = _heat_W(view.plant, left, window)
        if np.sum((capacitance * slope_K_s) ** 2) <= NOISE_SHARE**2 * np.sum(np.var(heat, axis=1)):
            break
        window = min(longest, int(_LONGER * window) // 2 * 2 + 1)
    return window


def _heat_W(plant: Plant, left: Array, window: int) -> Array:
    """C dr/dt less the flows that r drives, at each sensor's node, for r = ``left`` (s, N) there."""
    heat = _heat_among_sensors_W(plant, left, window)
    hidden = _hidden(plant)
    if hidden.any():
        part, conductance = plant.part(hidden), _conductances_W_K(plant, hidden)
        followed = part.V @ part.modal(part.W @ _into_hidden_K_s(plant, left))
        heat -= conductance @ savgol_filter(followed, window, 1, axis=1)
        # where a hidden node began is not known: such that it leaves the least heat
        starts = conductance @ part.decays(left.shape[1])
        began = np.linalg.lstsq(starts.reshape(len(starts), -1).T, heat.ravel(), rcond=1e-6)[0]
        heat -= np.einsum("i,isk->sk", began, starts)
    return _in_whole_windows(heat, window)


def _heat_among_sensors_W(plant: Plant, left: Array, window: int) -> Array:
    """As :func:`_heat_W`, if r were zero wherever there is no sensor; at the ends without a whole window."""
    slope = savgol_filter(left, window, 1, deriv=1, delta=plant.period_s, axis=1)
    level = savgol_filter(left, window, 1, axis=1)
    return np.asarray(plant.capacitance[plant.reads, None] * slope - _conductances_W_K(plant, plant.reads) @ level)


def _conductances_W_K(plant: Plant, nodes: NDArray[np.intp] | NDArray[np.bool_]) -> Array:
    """The heat into each sensor's node by each of ``nodes``, per K, (s, k)."""
    return np.asarray(plant.capacitance[plant.reads, None] * plant.A[np.ix_(plant.reads, nodes)])


def _in_whole_windows(rows: Array, window: int) -> Array:
    """``rows`` (..., N), at the ends held at what the first and the last whole window give."""
    half = window // 2
    kept = np.clip(np.arange(rows.shape[-1]), half, rows.shape[-1] - 1 - half)
    return np.asarray(rows[..., kept])


def _hidden(plant: Plant) -> NDArray[np.bool_]:
    """Which nodes have no sensor, (n,)."""
    return ~np.isin(np.arange(len(plant.nodes)), plant.reads)


def _into_hidden_K_s(plant: Plant, left: Array) -> Array:
    """What ``left`` (s, N) at the sensors does to each node without one, (k, N)."""
    return np.asarray(plant.A[np.ix_(_hidden(plant), plant.reads)] @ left)


def _ambient_error_degC(view: View) -> Array | None:
    """True less estimate, (N,), of the ambient that balances the measured nodes which are joined to it; NaN in gaps.

    Each asks for q / G more than there was; together, weighted by their conductances G, for sum q / sum G. What a node
    without a sensor does follows from the sensors and that same ambient, from equilibrium. None where no measured node
    is joined to the ambient, or those without a sensor make it run away.
    """
    plant, hidden = view.plant, _hidden(view.plant)
    conductance = conductances_to_ambient(plant)[plant.reads]
    joined, total = conductance > 0, conductance.sum()
    if not joined.any() or view.record.samples < _SHORTEST:
        return None
    left, window = _left(view), heat_window_samples(view)
    excess = _heat_among_sensors_W(plant, left, window)[joined].sum(axis=0) / total
    if hidden.any():
        inflow = _conductances_W_K(plant, hidden)[joined].sum(axis=0) / total
        air = (conductances_to_ambient(plant) / plant.capacitance)[hidden]
        A = plant.part(hidden).A - np.outer(air, inflow)
        if np.linalg.eigvals(A).real.max() >= 0:
            return None
        drive = _into_hidden_K_s(plant, left) + np.outer(air, excess)
        excess = excess - inflow @ _followed(A, drive, plant.period_s)
    known = ~np.isnan(view.residual_degC[joined]).any(axis=0)
    return np.where(known, -_in_whole_windows(excess, window), np.nan)


def _followed(A: Array, drive: Array, period_s: float) -> Array:
    """x (k, N) with dx/dt = A x + ``drive`` (k, N), from equilibrium."""
    unit, time_s = np.eye(len(A)), period_s * np.arange(drive.shape[1])
    start = -np.linalg.solve(A, drive[:, 0])
    return np.asarray(lsim((A, unit, unit, 0 * unit), drive.T, time_s, start)[1]).reshape(-1, len(A)).T


def _left(view: View) -> Array:
    """Measured less simulated, (s, N), with straight lines over gaps."""
    return np.array([bridged(row) for row in view.residual_degC])


def _white_noise_degC(rows: Array) -> Array:
    """Per row of (s, N) the deviation of what is in it from one sample to the next, by its second differences."""
    return np.asarray(np.abs(np.diff(rows, 2, axis=1)).mean(axis=1) * np.sqrt(np.pi / 2.0) / np.sqrt(6.0))
