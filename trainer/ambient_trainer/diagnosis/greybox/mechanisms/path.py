"""Conduction path between two nodes, or from nodes to a logged temperature: G, or g w(t) with a logged flow w."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from ambient_trainer.circuits.addition import with_edge
from ambient_trainer.circuits.circuit import Circuit, Node
from ambient_trainer.data.trace import Array
from ambient_trainer.diagnosis.greybox.context import Context
from ambient_trainer.diagnosis.greybox.expression import Expression, words_in
from ambient_trainer.diagnosis.greybox.mechanisms import Joined
from ambient_trainer.diagnosis.greybox.model import Mechanism, Number
from ambient_trainer.diagnosis.greybox.network import Network
from ambient_trainer.diagnosis.record import Record

_PROBES = 1e-3, 1.0
"""Of the conductance of the node: what a strong path does is not in proportion to what a weak one does."""
_GIVEN = {"in", "inlet", "mains", "supply", "coolant", "chiller", "room"}
"""Words in the name of a temperature that is given from outside, and answers to nothing that acts on a node."""


@dataclass(frozen=True)
class Path(Joined):
    """A conductance between two ``ends`` a place, in proportion to its driver if it has one."""

    ends: tuple[str, ...] = ()
    logged: tuple[str, ...] = ()
    probe: float = _PROBES[0]

    cause = "path"
    noun = "an unmodelled conduction path"
    least = 0.03
    by_place = True

    def apply(self, network: Network, values: Array, record: Record) -> None:
        weight = None if self.permanent and self.driver is None else self.weight(record)
        for (one, other), conductance in zip(self.pairs, values.T, strict=True):
            if other not in (*network.nodes, *network.boundaries):
                network.add_boundary(other, record.signals[f"{other}_degC"])
            network.link(one, other, conductance, weight)

    @property
    def pairs(self) -> list[tuple[str, str]]:
        """The two ends of each place."""
        return list(zip(self.ends[::2], self.ends[1::2]))

    @property
    def endogenous(self) -> bool:
        return bool(self.logged) and not _is_given(self.ends[1])

    @property
    def exogenous(self) -> bool:
        return bool(self.logged) and not self.endogenous

    def probes(self) -> Sequence[Sequence[float]]:
        # of several the others are as good as absent
        shares = np.where(np.eye(len(self.numbers), dtype=bool), self.probe, 1e-6 * self.probe)
        return (shares * [each.value for each in self.numbers]).tolist()

    def started(self, amounts: Sequence[float]) -> Mechanism | None:
        shares = np.clip(self.probe * np.array(amounts), self.least, self.most)
        return self.with_values((shares * [each.value for each in self.numbers]).tolist())

    def at_places(self, kept: Sequence[int]) -> Mechanism:
        ends = tuple(end for each in kept for end in self.pairs[each])
        return Mechanism.at_places(replace(self, ends=ends), kept)

    def native(self, circuit: Circuit) -> Circuit | None:
        if self.driver is not None:
            return None
        for (one, other), number in zip(self.pairs, self.numbers):
            if other not in {node.name for node in circuit.nodes}:
                circuit = replace(circuit, nodes=(*circuit.nodes, Node(other, None, other)))
            circuit = with_edge(circuit, one, other, 1.0 / number.value)
        return circuit

    def meaning(self, number: Number) -> str:
        one, other = self.pairs[self.numbers.index(number)]
        return f"conductance between {one} and {other}"


def _is_given(name: str) -> bool:
    return not _GIVEN.isdisjoint(words_in(name))


def candidates(context: Context) -> Iterator[Path]:
    """Every pair of nodes that is not joined, and every node with every other logged temperature, and all with one that
    is given, by itself or carried by a logged flow."""
    for index, one in enumerate(context.nodes):
        for other in context.nodes[index + 1 :]:
            if not context.joined(one, other):
                yield from _paths(context, [(one, other)])
    for other in context.other_temperatures:
        for driver in [None, *context.flows]:
            apart = [each for each in context.nodes if driver is not None or not context.joined(each, other)]
            # what answers to a node may answer to them all
            groups = context.groups(apart) if _is_given(other) else [(each,) for each in apart]
            for nodes in groups:
                yield from _paths(context, [(one, other) for one in nodes], driver, logged=(f"{other}_degC",))


def _paths(
    context: Context, pairs: list[tuple[str, str]], driver: Expression | None = None, logged: tuple[str, ...] = ()
) -> Iterator[Path]:
    size, unit = (1.0, "W/K") if driver is None else (context.size(driver), driver.per("W/K"))
    places, ends = tuple("-".join(each) for each in pairs), tuple(chain(*pairs))
    numbers = tuple(Number(f"G_{one}_{other}", unit, context.conductance(one) / size, log=True) for one, other in pairs)
    return (Path(places, numbers, driver, ends=ends, logged=logged, probe=each) for each in _PROBES)


def distinct(context: Context) -> list[Path]:
    """Each by itself once."""
    alone = (each for each in candidates(context) if each.driver is None and len(each.places) == 1)
    return list({each.key: each for each in alone}.values())


def begun(context: Context) -> Iterator[Mechanism]:
    """The same for a while."""
    return candidates(context)
