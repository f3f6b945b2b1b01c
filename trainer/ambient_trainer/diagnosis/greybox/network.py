"""Simulation of thermal networks, P lanes at once: one topology, each lane with its own parameters.

Node i of a lane balances

    C_i dT_i/dt = sum_j K_ij (T_j - T_i) + sum_b G_ib (U_b - T_i) + q_i(t) + v_i(t, T),

with other nodes T_j, prescribed boundaries U_b, heat q that is known in advance, and terms v that are not linear or
vary with time. Without v the modes of the network are exact one-pole filters (first-order hold); v is added to them
as a further input that is predicted and corrected from sample to sample (exponential Runge-Kutta of order 2).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ambient_trainer.data.trace import Array
from ambient_trainer.diagnosis.greybox.recursion import Terms, filtered, heat_along_trajectory, nonlinear_response
from ambient_trainer.diagnosis.record import averaged
from ambient_trainer.lti.lag import lag_weights

Reading = Callable[[Array], None]
"""Modifies the sensors' readings (P, s, N) in place."""

ABSURD_DEGC = 1e4
_UNWARNED = np.errstate(all="ignore")
"""An unstable lane is not finite."""


@dataclass
class Network:
    """P lanes on N steps of ``period_s``, ``every`` of them to a reading; mechanisms add to it in place."""

    time_s: Array
    period_s: float
    nodes: list[str]
    capacitance: Array
    between: Array
    boundaries: list[str]
    boundary_degC: Array
    to_boundary: Array
    reads: NDArray[np.intp]
    sensors: tuple[str, ...]
    heat: list[tuple[int, Array, Array]] = field(default_factory=list)
    """Heat inputs: node, amplitude in each lane (P,), and the driver (N,)."""
    flows: list[tuple[Any, Array]] = field(default_factory=list)
    """Heat inputs that differ in each lane over time: nodes (k,), W (P, k, N)."""
    loss: Array = field(default_factory=lambda: np.zeros(0))
    """The circuit's own conductance to each boundary (P, n, b)."""
    varying_loss: dict[tuple[int, int], Array] = field(default_factory=dict)
    """Time-varying part of a node's conductance to a boundary, in addition to ``to_boundary``, (P, N)."""
    varying: list[tuple[NDArray[np.intp], Array, Array]] = field(default_factory=list)
    """Time-varying conductances: nodes (k,), W/K (P, k, N), and the temperature on the other side (broadcast)."""
    pairs: list[tuple[int, int, Array]] = field(default_factory=list)
    """Time-varying conductances between two nodes, (P, N)."""
    shares: list[tuple[NDArray[np.intp], int, Array]] = field(default_factory=list)
    """Relative changes of losses: nodes (k,), a boundary, and the share (P, k, N)."""
    powers: list[tuple[int, int, Array]] = field(default_factory=list)
    """Losses G |d/d0|^p d instead of G d: node, boundary, and d0 in K and p (2, P). What covers a node lowers that,
    what blows on it adds a loss that is in proportion."""
    phases: list[tuple[int, int, Array]] = field(default_factory=list)
    """Bodies that freeze or melt: node, body, and G in W/K between them, heat of fusion in K, melting point in degC,
    and -1 where the body begins solid, else 1 (4, P)."""
    readings: list[Reading] = field(default_factory=list)
    every: int = 1

    @property
    def lanes(self) -> int:
        """P."""
        return len(self.capacitance)

    @property
    def nonlinear(self) -> bool:
        """Whether it is simulated step by step."""
        return bool(self.varying or self.pairs or self.powers or self.phases)

    def copied(self) -> Network:
        """A copy to which mechanisms can be added."""
        given = {each.name: getattr(self, each.name) for each in fields(self)}
        copied = list | dict | np.ndarray
        own: dict[str, Any] = {name: row.copy() for name, row in given.items() if isinstance(row, copied)}
        return replace(self, **own)

    def index(self, node: str) -> int:
        """The number of a node."""
        return self.nodes.index(node)

    def boundary(self, name: str) -> int:
        """The number of a boundary."""
        return self.boundaries.index(name)

    def add_node(self, name: str, capacitance: Array) -> int:
        """A further node, joined to nothing yet, with ``capacitance`` (P,) in J/K."""
        self.nodes.append(name)
        self.capacitance = np.concatenate([self.capacitance, capacitance[:, None]], axis=1)
        self.between = _grown(self.between, 1, 1)
        self.to_boundary, self.loss = _grown(self.to_boundary, 1, 0), _grown(self.loss, 1, 0)
        return len(self.nodes) - 1

    def add_boundary(self, name: str, degC: Array) -> int:
        """A further prescribed temperature (N,)."""
        self.boundaries.append(name)
        self.boundary_degC = np.concatenate([self.boundary_degC, degC[None]])
        self.to_boundary = _grown(self.to_boundary, 0, 1)
        return len(self.boundaries) - 1

    def join(self, one: int, other: int, conductance: Array) -> None:
        """A path of ``conductance`` (P,) in W/K between two nodes."""
        self.between[:, one, other] += conductance
        self.between[:, other, one] += conductance

    def link(self, node: str, other: str, conductance: Array, weight: Array | None = None) -> None:
        """A path of ``conductance`` (P,) from a node to another, or a boundary, times ``weight`` (N,) if it varies."""
        index, inside = self.index(node), other in self.nodes
        beyond = self.index(other) if inside else self.boundary(other)
        if weight is None and inside:
            self.join(index, beyond, conductance)
        elif weight is None:
            self.to_boundary[:, index, beyond] += conductance
        elif inside:
            self.pairs.append((index, beyond, conductance[:, None] * weight))
        else:
            self.vary([index], conductance[:, None, None] * weight, self.boundary_degC[beyond])

    @_UNWARNED
    def simulate(self, start_degC: Array) -> Array:
        """Sensor readings (P, s, N / every) from ``start_degC`` (P, n); unstable lanes are not finite."""
        out, modes = self._modes(start_degC)
        return self._sensed(out[:, self.reads] @ modes)

    @_UNWARNED
    def nodes_degC(self, start_degC: Array) -> Array:
        """Temperatures of all nodes, (P, n, N)."""
        out, modes = self._modes(start_degC)
        return np.asarray(out @ modes)

    @_UNWARNED
    def read(self, nodes_degC: Array) -> Array:
        """Sensor readings (P, s, N / every) of node temperatures (P, n, N): means over the steps of a reading."""
        return self._sensed(nodes_degC[:, self.reads])

    def _sensed(self, read: Array) -> Array:
        for change in self.readings:
            change(read)
        return read if self.every == 1 else averaged(read, self.every)

    def vary(self, nodes: Sequence[int], conductance: Array, degC: Array) -> None:
        """Conductances (P, k, N) that vary from ``nodes`` to a prescribed temperature, which is broadcast to them."""
        self.varying.append((np.array(nodes, dtype=np.intp), conductance, degC))

    def change_loss(self, nodes: NDArray[np.intp], boundary: int, share: Array) -> None:
        """Shares (P, k, N) more of what ``nodes`` lose to a boundary as it stands."""
        self.shares.append((nodes, boundary, share))
        for node, more in zip(nodes.tolist(), np.moveaxis(share, 1, 0)):
            row = self.varying_loss.get((node, boundary), np.zeros((self.lanes, 1)))
            more = more * (self.to_boundary[:, node, boundary, None] + row)
            mean = more.mean(axis=1)
            self.to_boundary[:, node, boundary] += mean
            more -= mean[:, None]
            # a mean is rounded in each lane by itself
            if np.ptp(more, axis=1).any():
                self.varying_loss[node, boundary] = row + more
                self.vary([node], more[:, None], self.boundary_degC[boundary])

    def _active(self) -> NDArray[np.intp]:
        """The nodes whose heat is not known in advance."""
        varying = [node for nodes, _, _ in self.varying for node in nodes]
        joined = [node for one, other, _ in (*self.pairs, *self.phases) for node in (one, other)]
        return np.unique(np.array([*varying, *joined, *(node for node, _, _ in self.powers)], dtype=np.intp))

    def _terms(self, active: NDArray[np.intp]) -> Terms:
        """All heat that depends on the temperatures of ``active`` nodes."""
        lanes, samples = self.lanes, len(self.time_s)
        known, fall = np.zeros((2, lanes, len(active), samples))
        for nodes, conductance, degC in self.varying:
            places = np.searchsorted(active, nodes)
            known[:, places] += conductance * degC
            fall[:, places] += conductance

        def stacked(terms: Sequence[tuple[int, int, Array]], *shape: int) -> tuple[NDArray[np.intp], Array]:
            ends = np.array([(one, other) for one, other, _ in terms], dtype=np.intp).reshape(-1, 2)
            return ends, np.array([values for _, _, values in terms], dtype=float).reshape(-1, *shape)

        pairs, pair_G = stacked(self.pairs, lanes, samples)
        losses, power = stacked(self.powers, 2, lanes)
        bodies, phase = stacked(self.phases, 4, lanes)
        pair_nodes, power_node, phase_nodes = (np.searchsorted(active, each) for each in (pairs, losses[:, 0], bodies))
        air_degC = self.boundary_degC[losses[:, 1]]
        power_G = np.zeros((len(losses), lanes, samples))
        for row, (node, air) in zip(power_G, losses.tolist()):
            row += self.loss[:, node, air, None]
            for nodes, boundary, share in self.shares:
                for lower in np.minimum(np.moveaxis(share, 1, 0)[(nodes == node) & (boundary == air)], 0.0):
                    row *= 1.0 + lower
        return Terms(known, fall, pair_nodes, pair_G, power_node, air_degC, power_G, power, phase_nodes, phase)

    def linearise_along(self, nodes_degC: Array) -> None:
        """Linearise along ``nodes_degC`` (n, N), the first nodes of this network: known heat."""
        active = self._active()
        along = [nodes_degC[each] if each < len(nodes_degC) else nodes_degC.mean(axis=0) for each in active]
        if along:
            self.flows.append((active, heat_along_trajectory(np.array(along), self._terms(active))))
        self.varying, self.pairs, self.powers, self.phases = [], [], [], []

    def _modes(self, start_degC: Array) -> tuple[Array, Array]:
        """Output matrix from modes to nodes (P, n, n), and the modes (P, n, N)."""
        root = np.sqrt(self.capacitance)
        loss = self.between.sum(axis=2) + self.to_boundary.sum(axis=2)
        coupled = self.between / (root[:, :, None] * root[:, None, :])
        index = np.arange(len(self.nodes))
        coupled[:, index, index] -= loss / self.capacitance
        rates, Q = np.linalg.eigh(coupled)
        rates = np.minimum(rates, -1e-12)
        into, out = Q.transpose(0, 2, 1) / root[:, None, :], Q / root[:, :, None]
        kept, before, now = lag_weights(-1.0 / rates, self.period_s)
        before, now = -before / rates, -now / rates
        first = (Q.transpose(0, 2, 1) @ (root * start_degC)[:, :, None])[:, :, 0]
        modes = filtered(self._drive(into), kept, before, now, first)
        if self.nonlinear:
            active = self._active()
            out_k, into_k = np.ascontiguousarray(out[:, active]), np.ascontiguousarray(into[:, :, active])
            modes += nonlinear_response(out_k @ modes, kept, before, now, into_k, out_k, self._terms(active))
        return out, modes

    def _drive(self, into: Array) -> Array:
        """Input to the modes (P, n, N), given the matrix from node heat to modes (P, n, n)."""
        heated = [node for node, _, _ in self.heat]
        amounts = np.column_stack([np.zeros((self.lanes, 0)), *(amount for _, amount, _ in self.heat)])
        weights = np.concatenate([into @ self.to_boundary, into[:, :, heated] * amounts[:, None, :]], axis=2)
        drive: Array = weights @ np.concatenate([self.boundary_degC, *(row[None] for _, _, row in self.heat)])
        for nodes, flow in self.flows:
            drive += into[:, :, nodes] @ flow
        return drive


def _grown(values: Array, rows: int, columns: int) -> Array:
    """Values (P, n, m) with rows and columns of zeros behind; NumPy's own padding takes ten times as long."""
    lanes, n, m = values.shape
    result = np.zeros((lanes, n + rows, m + columns))
    result[:, :n, :m] = values
    return result
