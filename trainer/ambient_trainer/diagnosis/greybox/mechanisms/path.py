"""A path between two nodes that the circuit does not join, or from a node to a logged temperature: G, or g w(t)
where a logged flow w carries it."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

from ambient_trainer.circuits.addition import with_edge
from ambient_trainer.circuits.circuit import Circuit, Node
from ambient_trainer.data.trace import Array
from ambient_trainer.diagnosis.greybox.expression import Expression, words_in
from ambient_trainer.diagnosis.greybox.mechanisms import Joined
from ambient_trainer.diagnosis.greybox.model import Mechanism, Number
from ambient_trainer.diagnosis.greybox.network import Network
from ambient_trainer.diagnosis.greybox.scene import Scene
from ambient_trainer.diagnosis.record import Record

_PROBES = 1e-3, 1.0
"""Of the conductance of the node: what a strong path does is not in proportion to what a weak one does."""
_GIVEN = {"in", "inlet", "mains", "supply", "coolant", "chiller", "room"}
"""Words in the name of a temperature that is given from outside, and answers to nothing that acts on a node."""


@dataclass(frozen=True)
class Path(Joined):
    """A conductance between ``ends``, in proportion to its driver if it has one."""

    ends: tuple[str, str] = ("", "")
    logged: tuple[str, ...] = ()
    probe: float = _PROBES[0]

    cause = "path"
    noun = "a conduction path that the circuit lacks"
    least = 0.03

    def apply(self, network: Network, values: Array, record: Record) -> None:
        one, other = self.ends
        if other not in (*network.nodes, *network.boundaries):
            network.add_boundary(other, record.signals[f"{other}_degC"])
        constant = self.lasts and self.driver is None
        network.link(one, other, values[:, 0], None if constant else self.weight(record))

    @property
    def responds(self) -> bool:
        return f"{self.ends[1]}_degC" in self.logged and _GIVEN.isdisjoint(words_in(self.ends[1]))

    def native(self, circuit: Circuit) -> Circuit | None:
        one, other = self.ends
        if self.driver is not None:
            return None
        if other not in {node.name for node in circuit.nodes}:
            circuit = replace(circuit, nodes=(*circuit.nodes, Node(other, None, other)))
        return with_edge(circuit, one, other, 1.0 / self.numbers[0].value)

    def meaning(self, number: Number) -> str:
        return f"conductance between {self.ends[0]} and {self.ends[1]}"


def candidates(scene: Scene) -> Iterator[Path]:
    """Every pair of nodes that is not joined, and every node with every other logged temperature, by itself or carried
    by a logged flow."""
    for index, one in enumerate(scene.nodes):
        for other in scene.nodes[index + 1 :]:
            if not scene.joined(one, other):
                yield from _paths(scene, (one, other))
        for other in scene.other_temperatures:
            for driver in [None, *scene.flows]:
                if driver is not None or not scene.joined(one, other):
                    yield from _paths(scene, (one, other), driver, logged=(f"{other}_degC",))


def _paths(
    scene: Scene, ends: tuple[str, str], driver: Expression | None = None, logged: tuple[str, ...] = ()
) -> Iterator[Path]:
    place, conductance = "-".join(ends), scene.conductance(ends[0])
    size, unit = (1.0, "W/K") if driver is None else (scene.size(driver), driver.per("W/K"))
    number = Number(f"G_{ends[0]}_{ends[1]}", unit, conductance / size, log=True)
    return (Path((place,), (number,), driver, ends=ends, logged=logged, probe=each) for each in _PROBES)


def distinct(scene: Scene) -> list[Path]:
    """Each by itself once."""
    return list({each.key: each for each in candidates(scene) if each.driver is None}.values())


def begun(scene: Scene) -> Iterator[Mechanism]:
    """The same for a while."""
    return candidates(scene)
