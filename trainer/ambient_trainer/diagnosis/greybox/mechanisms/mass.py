"""A thermal mass of its own behind a node, which may see the ambient, too."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ambient_trainer.circuits.addition import with_body, with_edge
from ambient_trainer.circuits.circuit import AMBIENT, Circuit
from ambient_trainer.data.trace import Array
from ambient_trainer.diagnosis.greybox.model import Mechanism, Number, unused
from ambient_trainer.diagnosis.greybox.network import Network
from ambient_trainer.diagnosis.greybox.scene import Scene
from ambient_trainer.diagnosis.record import Record

_PROBE = 1e-3
_LAGS = 6
_AIRED_S = 300.0
"""Time constant of a body that hangs in the air."""
_SLOWEST = 30.0
"""Times the record: beyond that a body is a boundary."""


@dataclass(frozen=True)
class HiddenMass(Mechanism):
    """Per place a conductance, a time constant behind it, and with ``sees_ambient`` a conductance to the air."""

    sees_ambient: bool = False

    adds_nodes = True
    shaped = True
    cause = "thermal_mass"
    noun = "a thermal mass that the circuit lacks"

    @property
    def structural(self) -> bool:
        return self.lasts or self.sees_ambient or len(self.places) > 1

    def apply(self, network: Network, values: Array, record: Record) -> None:
        each = 3 if self.sees_ambient else 2
        for index, place in enumerate(self.places):
            conductance, lag = values[:, each * index], values[:, each * index + 1]
            name = unused(network, f"{place}_mass")
            mass = network.add_node(name, conductance * lag)
            if self.lasts:
                network.join(mass, network.index(place), conductance)
            else:
                self._put(network, mass, network.index(place), values[:, each * index : each * index + 2], record)
            if self.sees_ambient:
                air = network.boundary(AMBIENT)
                network.to_boundary[:, mass, air] += values[:, each * index + 2]
                network.loss[:, mass, air] += values[:, each * index + 2]

    def _put(self, network: Network, mass: int, node: int, values: Array, record: Record) -> None:
        """It holds on within the window, and follows the air before and after."""
        conductance, weight = values[:, 0], self.weight(record)
        network.pairs.append((mass, node, conductance[:, None] * weight))
        if AMBIENT in network.boundaries:
            loose = (conductance * values[:, 1] / _AIRED_S)[:, None, None] * (1.0 - weight)
            network.vary([mass], loose, network.boundary_degC[network.boundary(AMBIENT)])

    def probes(self) -> Sequence[Sequence[float]]:
        each = 3 if self.sees_ambient else 2
        probes = []
        for index in range(len(self.places)):
            values = [number.value for number in self.numbers]
            # the others are as good as absent
            for other in range(len(self.places)):
                values[each * other] *= _PROBE if other == index else 1e-6 * _PROBE
            if self.sees_ambient:
                values[each * index + 2] *= _PROBE
            probes.append(values)
        return probes

    def started(self, amounts: Sequence[float]) -> Mechanism | None:
        each = 3 if self.sees_ambient else 2
        values = [number.value for number in self.numbers]
        for index, amount in enumerate(amounts):
            # to first order a second mass may seem to take heat from the first: it starts small, and the fit decides
            share = float(np.clip(_PROBE * amount, 0.1, 3.0))
            values[each * index] *= share
            if self.sees_ambient:
                values[each * index + 2] *= share
        return self.with_values(values)

    def native(self, circuit: Circuit) -> Circuit | None:
        each = 3 if self.sees_ambient else 2
        for index, place in enumerate(self.places):
            conductance, lag = (number.value for number in self.numbers[each * index : each * index + 2])
            nodes = len(circuit.nodes)
            circuit = with_body(circuit, place, conductance * lag, 1.0 / conductance)
            if self.sees_ambient:
                body = circuit.nodes[nodes].name
                circuit = with_edge(circuit, body, AMBIENT, 1.0 / self.numbers[each * index + 2].value)
        return circuit

    @property
    def _slower_than_the_record(self) -> bool:
        # one that is put there for a while has a bound of its own
        lag = self.numbers[1]
        return self.lasts and bool(lag.value > lag.high / _SLOWEST)

    def sentence_tail(self) -> str:
        return "slower than the record: a constant temperature does the same" * self._slower_than_the_record

    def product(self) -> tuple[str, str, tuple[int, int]] | None:
        if self._slower_than_the_record:
            return None
        return f"heat capacity of the mass behind {self.places[0]}", "J/K", (0, 1)

    def meaning(self, number: Number) -> str:
        place = number.name.split("_", 1)[1].removesuffix("_ambient").removesuffix("_mass")
        if number.name.startswith("lag_"):
            return f"time constant of the mass behind {place}"
        other = "the ambient" if number.name.endswith("_ambient") else place
        return f"conductance between {other} and the mass behind {place}"


def candidates(scene: Scene) -> Iterator[Mechanism]:
    """Behind every node, and behind all, with time constants from a few samples to half the record."""
    lags = np.geomspace(3 * scene.period_s, scene.longest_s / 6, _LAGS)
    for places in scene.groups(scene.nodes):
        for lag in lags:
            yield _mass(scene, places, float(lag), sees_ambient=False)
            if all(scene.loss(each) > 0 for each in places):
                yield _mass(scene, places, float(lag), sees_ambient=True)
    for node in scene.hidden_nodes:
        for lag in lags:
            yield _mass(scene, (node,), float(lag), sees_ambient=False)


def begun(scene: Scene) -> Iterator[Mechanism]:
    """A body that is put to a node, and may be taken away; one that is slower than the record is a loss."""
    for node in scene.nodes:
        for lag in np.geomspace(10 * scene.period_s, scene.longest_s / 12, 2):
            mass = _mass(scene, (node,), float(lag), sees_ambient=False)
            conductance, behind = mass.numbers
            yield replace(mass, numbers=(conductance, replace(behind, high=scene.longest_s / 3)))


def _mass(scene: Scene, places: tuple[str, ...], lag_s: float, sees_ambient: bool) -> HiddenMass:
    numbers: list[Number] = []
    for each in places:
        conductance = scene.conductance(each)
        numbers.append(Number(f"G_{each}_mass", "W/K", conductance, log=True))
        numbers.append(
            Number(f"lag_{each}_mass", "s", lag_s, log=True, low=scene.period_s / 3, high=_SLOWEST * scene.longest_s)
        )
        if sees_ambient:
            numbers.append(Number(f"G_{each}_mass_ambient", "W/K", conductance / 2, log=True))
    return HiddenMass(places, tuple(numbers), sees_ambient=sees_ambient)
