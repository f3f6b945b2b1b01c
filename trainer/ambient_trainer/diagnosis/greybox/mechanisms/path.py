"""A path between two nodes that the circuit does not join, or from a node to a body whose temperature is logged."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

from ambient_trainer.circuits.addition import with_edge
from ambient_trainer.circuits.circuit import Circuit, Node
from ambient_trainer.data.trace import Array
from ambient_trainer.diagnosis.greybox.mechanisms import Joined
from ambient_trainer.diagnosis.greybox.model import Mechanism, Number
from ambient_trainer.diagnosis.greybox.network import Network
from ambient_trainer.diagnosis.greybox.scene import Scene
from ambient_trainer.diagnosis.record import Record

_PROBES = 1e-3, 1.0
"""Of the conductance of the node: what a strong path does is not in proportion to what a weak one does."""


@dataclass(frozen=True)
class Path(Joined):
    """A conductance between ``ends``."""

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
        network.link(one, other, values[:, 0], None if self.lasts else self.weight(record))

    @property
    def responds(self) -> bool:
        return f"{self.ends[1]}_degC" in self.logged

    def native(self, circuit: Circuit) -> Circuit | None:
        one, other = self.ends
        if other not in {node.name for node in circuit.nodes}:
            circuit = replace(circuit, nodes=(*circuit.nodes, Node(other, None, other)))
        return with_edge(circuit, one, other, 1.0 / self.numbers[0].value)

    def meaning(self, number: Number) -> str:
        return f"conductance between {self.ends[0]} and {self.ends[1]}"


def candidates(scene: Scene) -> Iterator[Path]:
    """Every pair of nodes that is not joined, and every node with every other logged temperature."""
    for index, one in enumerate(scene.nodes):
        for other in [*scene.nodes[index + 1 :], *scene.other_temperatures]:
            if not scene.joined(one, other):
                conductance = Number(f"G_{one}_{other}", "W/K", scene.conductance(one), log=True)
                logged = (f"{other}_degC",) if other in scene.other_temperatures else ()
                for probe in _PROBES:
                    yield Path((f"{one}-{other}",), (conductance,), ends=(one, other), logged=logged, probe=probe)


def distinct(scene: Scene) -> list[Path]:
    """Each once."""
    return list({each.key: each for each in candidates(scene)}.values())


def begun(scene: Scene) -> Iterator[Mechanism]:
    """The same for a while."""
    return candidates(scene)
