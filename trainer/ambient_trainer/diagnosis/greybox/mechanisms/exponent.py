"""The loss grows with a power of the difference: G |d/d0|^p d, as in free convection (p about 0.25) or radiation."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ambient_trainer.circuits.circuit import AMBIENT
from ambient_trainer.data.trace import Array
from ambient_trainer.diagnosis.greybox.model import Mechanism, Number
from ambient_trainer.diagnosis.greybox.network import Network
from ambient_trainer.diagnosis.greybox.scene import Scene
from ambient_trainer.diagnosis.record import Record

_PROBE = 0.02
_SMALLEST = 0.02
"""Of the typical difference: below it the power is taken there."""


@dataclass(frozen=True)
class Exponent(Mechanism):
    """An exponent for each place; ``typical_degC`` is where the conductance is the circuit's own."""

    typical_degC: tuple[float, ...] = ()

    cause = "convection_law"

    def apply(self, network: Network, values: Array, record: Record) -> None:
        nodes = np.array([network.index(each) for each in self.places])
        air = network.boundary(AMBIENT)
        air_degC = network.boundary_degC[air][:, None, None]
        conductance = network.loss[:, nodes, air]
        typical = np.array(self.typical_degC)

        def term(degC: Array, index: int | slice, heat: Array) -> None:
            away = air_degC[index] - degC[..., nodes]
            share = np.log(np.maximum(np.abs(away) / typical, _SMALLEST))
            heat[..., nodes] += conductance * np.expm1(np.clip(values * share, -5, 5)) * away

        network.terms.append(term)

    def probes(self) -> Sequence[Sequence[float]]:
        return [[_PROBE if each is number else 0.0 for each in self.numbers] for number in self.numbers]

    def started(self, amounts: Sequence[float]) -> Mechanism | None:
        values = [
            float(np.clip(_PROBE * amount, number.low, number.high)) for amount, number in zip(amounts, self.numbers)
        ]
        return self.with_values(values) if any(values) else None


def candidates(scene: Scene) -> Iterator[Mechanism]:
    """Every node that is joined to the ambient, and all of them."""
    joined = [each for each in scene.nodes if scene.loss(each) > 0]
    for places in scene.groups(joined):
        numbers = tuple(Number(f"exponent_{each}", "1", 0.0, low=-0.3, high=0.8) for each in places)
        yield Exponent(places, numbers, typical_degC=tuple(scene.difference_degC(each) for each in places))
