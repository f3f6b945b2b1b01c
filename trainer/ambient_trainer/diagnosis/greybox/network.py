"""Thermal networks, many at once: P lanes of one topology with their own parameters, simulated together.

Node i of a lane balances

    C_i dT_i/dt = sum_j K_ij (T_j - T_i) + sum_b G_ib (U_b - T_i) + q_i(t) + v_i(t, T),

with other nodes T_j, prescribed boundaries U_b, heat q that is known in advance, and terms v that are not linear or
vary with time. Without v the modes of the network are exact one-pole filters (first-order hold); v is added to them
as a further input that is predicted and corrected from sample to sample (exponential Runge-Kutta of order 2).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from ambient_trainer.data.trace import Array
from ambient_trainer.lti.lag import lag_weights

Term = Callable[[Array, "int | slice", Array], None]
"""Adds heat in W to its third argument (..., P, n), given all nodes (..., P, n) at one sample, or along all of them."""
Reading = Callable[[Array], None]
"""Changes what the sensors read (P, s, N) in place."""

ABSURD_DEGC = 1e4


@dataclass
class Network:
    """P lanes on N samples every ``period_s``; what a mechanism adds, it adds in place."""

    time_s: Array
    period_s: float
    nodes: list[str]
    capacitance: Array
    between: Array
    boundaries: list[str]
    boundary_degC: Array
    to_boundary: Array
    heat: Array
    reads: NDArray[np.intp]
    sensors: tuple[str, ...]
    loss: Array = field(default_factory=lambda: np.zeros(0))
    """To each boundary as the circuit has it (P, n, b): what varies is a share of that."""
    varying: list[tuple[NDArray[np.intp], Array, Array]] = field(default_factory=list)
    """Conductances that vary: nodes (k,), W/K (N, P, k), and the temperature on the other side (broadcast to that)."""
    terms: list[Term] = field(default_factory=list)
    readings: list[Reading] = field(default_factory=list)

    @property
    def lanes(self) -> int:
        """P."""
        return len(self.capacitance)

    @property
    def nonlinear(self) -> bool:
        """Whether it is simulated step by step."""
        return bool(self.terms or self.varying)

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
        self.between = np.pad(self.between, ((0, 0), (0, 1), (0, 1)))
        self.to_boundary = np.pad(self.to_boundary, ((0, 0), (0, 1), (0, 0)))
        self.heat = np.pad(self.heat, ((0, 0), (0, 1), (0, 0)))
        self.loss = np.pad(self.loss, ((0, 0), (0, 1), (0, 0)))
        return len(self.nodes) - 1

    def add_boundary(self, name: str, degC: Array) -> int:
        """A further prescribed temperature (N,)."""
        self.boundaries.append(name)
        self.boundary_degC = np.concatenate([self.boundary_degC, degC[None]])
        self.to_boundary = np.pad(self.to_boundary, ((0, 0), (0, 0), (0, 1)))
        return len(self.boundaries) - 1

    def join(self, one: int, other: int, conductance: Array) -> None:
        """A path of ``conductance`` (P,) in W/K between two nodes."""
        self.between[:, one, other] += conductance
        self.between[:, other, one] += conductance

    def simulate(self, start_degC: Array) -> Array:
        """What the sensors read, (P, s, N), from ``start_degC`` (P, n); lanes that run away are not finite."""
        return self.read(self.nodes_degC(start_degC))

    def read(self, nodes_degC: Array) -> Array:
        """What the sensors make of all nodes (P, n, N), (P, s, N)."""
        read = nodes_degC[:, self.reads]
        for change in self.readings:
            change(read)
        return read

    def vary(self, nodes: Sequence[int], conductance: Array, degC: Array) -> None:
        """Conductances (N, P, k) that vary from ``nodes`` to a prescribed temperature, which is broadcast to them."""
        self.varying.append((np.array(nodes, dtype=np.intp), conductance, degC))

    def _variation(self) -> tuple[Array, Array]:
        """All of them together: heat in W (N, P, n) into nodes at 0 degC, and its fall per K."""
        shape = (len(self.time_s), self.lanes, len(self.nodes))
        heat, fall = np.zeros(shape), np.zeros(shape)
        for nodes, conductance, degC in self.varying:
            heat[..., nodes] += conductance * degC
            fall[..., nodes] += conductance
        return heat, fall

    def frozen(self, nodes_degC: Array) -> None:
        """Take all terms as they are along ``nodes_degC`` (n, N), the first nodes of this network: known heat."""
        along = np.zeros((len(self.time_s), self.lanes, len(self.nodes)))
        along[:, :, : len(nodes_degC)] = nodes_degC.T[:, None, :]
        along[:, :, len(nodes_degC) :] = nodes_degC.mean(axis=0)[:, None, None]
        heat, fall = self._variation()
        heat -= fall * along
        for term in self.terms:
            term(along, slice(None), heat)
        self.heat = self.heat + heat.transpose(1, 2, 0)
        self.terms, self.varying = [], []

    def nodes_degC(self, start_degC: Array) -> Array:
        """All nodes, (P, n, N)."""
        root = np.sqrt(self.capacitance)
        loss = self.between.sum(axis=2) + self.to_boundary.sum(axis=2)
        coupled = self.between / (root[:, :, None] * root[:, None, :])
        index = np.arange(len(self.nodes))
        coupled[:, index, index] -= loss / self.capacitance
        rates, Q = np.linalg.eigh(coupled)
        rates = np.minimum(rates, -1e-12)
        into, out = Q.transpose(0, 2, 1) / root[:, None, :], Q / root[:, :, None]
        drive = into @ (self.to_boundary @ self.boundary_degC + self.heat)
        kept, before, now = lag_weights(-1.0 / rates, self.period_s)
        before, now = -before / rates, -now / rates
        first = (Q.transpose(0, 2, 1) @ (root * start_degC)[:, :, None])[:, :, 0]
        modes = _filtered(drive, kept, before, now, first)
        if not self.nonlinear:
            return np.asarray(out @ modes)
        return self._with_terms(np.asarray(out @ modes), into, out, (kept, before, now))

    def _with_terms(self, linear: Array, into: Array, out: Array, weights: tuple[Array, Array, Array]) -> Array:
        kept, before, now = weights
        both = before + now
        # (N, P, n): each step reads one slice
        along = np.ascontiguousarray(linear.transpose(2, 0, 1))
        known, fall = self._variation()
        times = _elementwise if len(self.nodes) == 1 else _matrices
        terms = self.terms

        def added(nodes: Array, index: int) -> Array:
            heat = known[index] - fall[index] * nodes
            for term in terms:
                term(nodes, index, heat)
            return times(into, heat)

        modes = np.zeros(kept.shape)
        with np.errstate(all="ignore"):
            last = added(along[0], 0)
            for index in range(1, len(along)):
                rest = kept * modes
                predicted = added(along[index] + times(out, rest + both * last), index)
                modes = rest + before * last + now * predicted
                along[index] += times(out, modes)
                last = added(along[index], index)
        return along.transpose(1, 2, 0)


def _matrices(matrices: Array, vectors: Array) -> Array:
    """Of each lane, (P, n, n) times (P, n)."""
    return np.asarray((matrices @ vectors[:, :, None])[:, :, 0])


def _elementwise(matrices: Array, vectors: Array) -> Array:
    """The same of a single node."""
    return np.asarray(matrices[:, :, 0] * vectors)


def _filtered(drive: Array, kept: Array, before: Array, now: Array, first: Array) -> Array:
    """Each lane's modes (P, n, N) by their recursion from ``first`` (P, n)."""
    modes = np.empty(drive.shape)
    begin = first - now * drive[:, :, 0]
    for lane in range(drive.shape[0]):
        for mode in range(drive.shape[1]):
            b = [now[lane, mode], before[lane, mode]]
            a = [1.0, -kept[lane, mode]]
            modes[lane, mode], _ = lfilter(b, a, drive[lane, mode], zi=[begin[lane, mode]])
    return modes
