"""A grey-box model: a circuit in forward form with added mechanisms, whose parameters are estimated together.

Every number has a coordinate z: its logarithm where it is positive by nature, else its multiple of ``scale``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ambient_trainer.circuits.circuit import Circuit, Parameter
from ambient_trainer.data.trace import Array
from ambient_trainer.diagnosis.greybox.expression import Expression, Samples
from ambient_trainer.diagnosis.greybox.network import Network
from ambient_trainer.diagnosis.record import Record

PRIOR_SD, FREE_SD = 3.0, 20.0
"""Prior of a circuit's parameter, a factor of twenty; of a mechanism's parameter, practically uninformative."""
_WITHIN_SD = 4.0
"""Bounds that a circuit's file gives are so many standard deviations apart: they advise, and bind nothing."""


@dataclass(frozen=True)
class Number:
    """A parameter to be estimated: in ``unit``, logarithmic or a multiple of ``scale``, within physical bounds."""

    name: str
    unit: str
    value: float
    log: bool = False
    scale: float = 1.0
    low: float = -np.inf
    high: float = np.inf
    prior_sd: float = FREE_SD
    """Prior standard deviation of its coordinate about its initial value."""
    saturates: bool = False
    """Whether its effect saturates at the upper bound, so that an estimate there is acceptable."""

    @property
    def z(self) -> float:
        """Its coordinate."""
        return float(np.log(self.value)) if self.log else self.value / self.scale

    def natural(self, z: Array) -> Array:
        """The number itself at coordinate z."""
        return np.exp(np.clip(z, -60, 60)) if self.log else z * self.scale

    @property
    def range_z(self) -> tuple[float, float]:
        """The bounds of its coordinate."""
        if self.log:
            low = np.log(self.low) if self.low > 0 else -60.0
            return float(low), float(np.log(self.high)) if np.isfinite(self.high) else 60.0
        return self.low / self.scale, self.high / self.scale

    @property
    def at_bound(self) -> bool:
        """Whether it is at one of its bounds."""
        ends = self.range_z[: 1 if self.saturates else 2]
        return any(abs(self.z - end) < 1e-6 * max(1.0, abs(end)) for end in ends)

    def at(self, z: float) -> Number:
        """The number at coordinate z."""
        return replace(self, value=float(self.natural(np.float64(z))))


@dataclass(frozen=True)
class Mechanism:
    """Model extension: a cause at one or several places, driven by an expression of logged columns or unlogged."""

    places: tuple[str, ...]
    numbers: tuple[Number, ...]
    driver: Expression | None = None
    onset_s: float | None = None
    end_s: float | None = None

    cause = ""
    """Its key in a diagnosis."""
    noun = ""
    """The same as a noun phrase."""
    instrument = False
    """It is a sensor fault, not a thermal effect."""

    @property
    def endogenous(self) -> bool:
        """Whether its driver is a temperature that responds to the same causes."""
        return False

    @property
    def exogenous(self) -> bool:
        """Whether its driver is a temperature that is imposed from outside."""
        return False

    @property
    def structural(self) -> bool:
        """Whether it belongs to the design of the device: known-good records would have shown it."""
        return False

    @property
    def tuned(self) -> bool:
        """Whether its driver has a delay or a threshold, which is searched on a grid and then refined."""
        return False

    @property
    def ambiguous(self) -> bool:
        """Whether a quite different cause gives the same readings."""
        return False

    @property
    def step_like(self) -> bool:
        """Whether the readings jump where it begins or ends."""
        return False

    @property
    def slow(self) -> bool:
        """Whether it is a mass slower than the record: a constant temperature acts the same."""
        return False

    @property
    def assumes(self) -> float:
        """What it assumes besides its parameters."""
        return 0.0

    may_end = True
    """Whether what has begun may end within the record: a drift that ends is a step."""
    adds_nodes = False
    """It is applied before mechanisms that act on nodes."""
    by_place = False
    """It has a separate amount at each of several places."""
    of_reference = False
    """Whether it is a fault of the ambient's reference: it affects all sensors."""
    visible_in_readings = False
    """It can be seen in the readings without a model: a sensor that is stuck."""
    multistart = False
    """It is strongly nonlinear: it is fitted from several starting points."""

    @property
    def permanent(self) -> bool:
        """Whether it acts throughout the record."""
        return (self.onset_s, self.end_s) == (None, None)

    def overlaps(self, other: Mechanism) -> bool:
        """Whether both act at some time."""
        onsets = (each.onset_s for each in (self, other) if each.onset_s is not None)
        ends = (each.end_s for each in (self, other) if each.end_s is not None)
        return max(onsets, default=-np.inf) < min(ends, default=np.inf)

    def apply(self, network: Network, values: Array, record: Record) -> None:
        """Add it to ``network``; ``values`` (P, k) are its numbers in each lane."""
        raise NotImplementedError

    def probes(self) -> Sequence[Sequence[float]]:
        """Small parameter values whose effects span its first-order effect."""
        raise NotImplementedError

    def started(self, amounts: Sequence[float]) -> Mechanism | None:
        """Initialised from the amounts of its probes in a linear fit; None where those are unphysical."""
        raise NotImplementedError

    def native(self, circuit: Circuit) -> Circuit | None:
        """``circuit`` with it as nodes, edges and sources; None where those cannot express it."""
        return None

    def meaning(self, number: Number) -> str:
        """Description of one of its parameters."""
        return number.name.replace("_", " ")

    def stated(self, value: float) -> float:
        """One of its parameters as it is reported."""
        return value

    def product(self) -> tuple[str, str, tuple[int, int]] | None:
        """Name, unit and factors of a product of two logarithmic parameters that is its magnitude, if any."""
        return None

    def sentence_tail(self) -> str:
        """A clause on how it varies; empty where it does not."""
        return ""

    def with_values(self, values: Sequence[float]) -> Mechanism:
        """It with other parameter values."""
        numbers = tuple(replace(each, value=float(value)) for each, value in zip(self.numbers, values))
        return replace(self, numbers=numbers)

    def at_places(self, kept: Sequence[int]) -> Mechanism:
        """It at some of its places only; each place has the same number of parameters."""
        count = len(self.numbers) // len(self.places)
        numbers = [number for each in kept for number in self.numbers[count * each : count * (each + 1)]]
        return replace(self, places=tuple(self.places[each] for each in kept), numbers=tuple(numbers))

    def weight(self, record: Record) -> Array:
        """Its driver within its window, (N,)."""
        shape = np.ones(record.samples) if self.driver is None else self.driver.value(samples_of(record))
        return shape * window(record, self.onset_s, self.end_s)

    @property
    def key(self) -> tuple[str, tuple[str, ...], str]:
        """Cause, places and driver."""
        return self.cause, self.places, "" if self.driver is None else self.driver.text

    def __str__(self) -> str:
        place = f" at {', '.join(self.places)}" if self.places else ""
        return f"{self.cause}{place}" + ("" if self.driver is None else f" by {self.driver.text}")


def samples_of(record: Record) -> Samples:
    """Samples of a record on which expressions are evaluated."""
    return Samples(record.signals, record.period_s)


def unused(network: Network, name: str) -> str:
    """``name``, or with a number behind it where the network has such a node."""
    numbered = (name if index == 1 else f"{name}_{index}" for index in range(1, len(network.nodes) + 2))
    return next(each for each in numbered if each not in network.nodes)


def window(record: Record, onset_s: float | None, end_s: float | None) -> Array:
    """1 from ``onset_s`` to ``end_s``, else 0; the share of a sample that lies inside."""

    def after(at_s: float | None, default: float) -> Array:
        if at_s is None:
            return np.full(record.samples, default)
        return np.clip((record.time_s - at_s) / record.period_s + 0.5, 0.0, 1.0)

    return after(onset_s, 1.0) - after(end_s, 0.0)


@dataclass(frozen=True)
class GreyBox:
    """A circuit in forward form with mechanisms."""

    circuit: Circuit
    own: tuple[Number, ...]
    mechanisms: tuple[Mechanism, ...] = ()

    @staticmethod
    def of(circuit: Circuit) -> GreyBox:
        """The model of a forward circuit without any mechanism; its parameters start at their initial values."""
        positive = {node.capacitance for node in circuit.states} | {edge.resistance for edge in circuit.edges}
        own = tuple(
            Number(
                each.name,
                each.unit,
                each.initial,
                log=each.name in positive,
                scale=abs(each.initial) or 1.0,
                prior_sd=_advised_sd(each, each.name in positive),
            )
            for each in circuit.parameters
            if each.free
        )
        return GreyBox(circuit, own)

    @cached_property
    def numbers(self) -> tuple[Number, ...]:
        """All numbers that are fitted."""
        return (*self.own, *(number for each in self.mechanisms for number in each.numbers))

    def z(self) -> Array:
        """Their coordinates (p,)."""
        return np.array([each.z for each in self.numbers])

    def at(self, z: Array) -> GreyBox:
        """The model at coordinates z (p,)."""
        numbers = tuple(number.at(value) for number, value in zip(self.numbers, z))
        mechanisms = (replace(each, numbers=numbers[self.span(at)]) for at, each in enumerate(self.mechanisms))
        return replace(self, own=numbers[: len(self.own)], mechanisms=tuple(mechanisms))

    def span(self, index: int) -> slice:
        """Slice of one mechanism's parameters among all."""
        first = len(self.own) + sum(len(each.numbers) for each in self.mechanisms[:index])
        return slice(first, first + len(self.mechanisms[index].numbers))

    def with_mechanism(self, mechanism: Mechanism) -> GreyBox:
        """The model with one more mechanism."""
        return replace(self, mechanisms=(*self.mechanisms, mechanism))

    def without(self, index: int) -> GreyBox:
        """The model without one of its mechanisms."""
        return replace(self, mechanisms=self.mechanisms[:index] + self.mechanisms[index + 1 :])

    def carries(self, index: int) -> bool:
        """Whether another mechanism acts on a node added by one of its mechanisms."""
        return bool(self.carried(index))

    def carried(self, index: int) -> list[Mechanism]:
        """Mechanisms that act on nodes added by one of its mechanisms."""
        own, mechanism = {node.name for node in self.circuit.states}, self.mechanisms[index]
        bodies = tuple(f"{place}_mass" for place in mechanism.places) if mechanism.adds_nodes else ()
        return [each for each in self.mechanisms if any(at.startswith(bodies) for at in {*each.places} - own)]

    def replaced(self, index: int, mechanism: Mechanism) -> GreyBox:
        """The model with another mechanism in the place of one."""
        return replace(self, mechanisms=(*self.mechanisms[:index], mechanism, *self.mechanisms[index + 1 :]))

    def values(self, z: Array) -> Array:
        """Numbers (P, p) at coordinates z (P, p)."""
        # all at once, as ``natural`` makes each
        log, scale = np.array([(each.log, each.scale) for each in self.numbers]).reshape(-1, 2).T
        return np.asarray(np.where(log > 0, np.exp(np.clip(z, -60, 60)), z * scale))

    def network(self, record: Record, z: Array) -> Network:
        """The network of P lanes at coordinates z (P, p), on the steps in which a record is simulated."""
        values, steps = self.values(z), record.simulated
        network = bare_network(self.circuit, steps, dict(zip((n.name for n in self.own), values.T)), len(z))
        network.every = record.every
        acting = [(each, values[:, self.span(at)]) for at, each in enumerate(self.mechanisms)]
        # what acts on a node's loss acts on that of the bodies behind it, too
        for mechanism, given in sorted(acting, key=lambda each: not each[0].adds_nodes):
            mechanism.apply(network, given, steps)
        return network


def _advised_sd(parameter: Parameter, positive: bool) -> float:
    """The standard deviation that a parameter's bounds advise."""
    if not positive or parameter.low <= 0 or not np.isfinite(parameter.high):
        return PRIOR_SD
    return min(PRIOR_SD, float(np.log(parameter.high / parameter.low)) / _WITHIN_SD)


def bare_network(circuit: Circuit, record: Record, free: dict[str, Array], lanes: int) -> Network:
    """The network of a forward circuit; ``free`` holds values (P,) of free parameters, others are as in the circuit."""
    fixed = {each.name: np.full(lanes, each.initial) for each in circuit.parameters if each.name not in free}
    value = {**fixed, **free}
    states = [node.name for node in circuit.states]
    prescribed = [node for node in circuit.nodes if node.capacitance is None]
    rows = {name: index for index, name in enumerate(circuit.inputs)}
    count = len(states)
    network = Network(
        record.time_s,
        record.period_s,
        states,
        np.stack([value[str(node.capacitance)] for node in circuit.states], axis=1),
        np.zeros((lanes, count, count)),
        [node.name for node in prescribed],
        np.array([record.inputs[rows[f"{node.sensor}_degC"]] for node in prescribed]),
        np.zeros((lanes, count, len(prescribed))),
        np.array([states.index(next(iter(output.states or ()))) for output in circuit.outputs]),
        tuple(output.name for output in circuit.outputs),
    )
    for edge in circuit.edges:
        one, other = edge.between
        conductance = 1.0 / value[edge.resistance]
        if one in states and other in states:
            network.join(states.index(one), states.index(other), conductance)
        elif one in states or other in states:
            inner, outer = (one, other) if one in states else (other, one)
            if outer in network.boundaries:
                network.to_boundary[:, states.index(inner), network.boundary(outer)] += conductance
    network.loss = network.to_boundary.copy()
    for source in circuit.sources:
        network.heat.append((states.index(source.into), value[source.share], record.inputs[rows[source.signal]]))
    return network
