"""Heat into nodes, proportional to a driver, or constant."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ambient_trainer.data.trace import Array
from ambient_trainer.diagnosis.greybox.expression import Expression
from ambient_trainer.diagnosis.greybox.model import Mechanism, Number
from ambient_trainer.diagnosis.greybox.network import Network
from ambient_trainer.diagnosis.greybox.scene import Scene
from ambient_trainer.diagnosis.record import Record


@dataclass(frozen=True)
class Heat(Mechanism):
    """q_i = k_i w(t): a number of each place."""

    cause = "heat_source"

    def apply(self, network: Network, values: Array, record: Record) -> None:
        weight = self.weight(record)
        for place, column in zip(self.places, values.T):
            network.heat[:, network.index(place)] += column[:, None] * weight

    def probes(self) -> Sequence[Sequence[float]]:
        return [[number.scale if each is number else 0.0 for each in self.numbers] for number in self.numbers]

    def started(self, amounts: Sequence[float]) -> Mechanism | None:
        values = [amount * number.scale for amount, number in zip(amounts, self.numbers)]
        # what may only warm starts by a little where a linear fit would have it cool: the circuit may move
        least = [number.low if number.low < 0 else 0.1 * number.scale for number in self.numbers]
        return self.with_values([max(value, low) for value, low in zip(values, least)])


def candidates(scene: Scene) -> Iterator[Mechanism]:
    """Every node, and all that have sensors together, by every driver and by none."""
    for places in scene.groups(scene.nodes):
        yield _heat(scene, places, None)
        for driver in scene.drivers:
            yield _heat(scene, places, driver)


def _heat(scene: Scene, places: tuple[str, ...], driver: Expression | None) -> Heat:
    size = 1.0 if driver is None else scene.size(driver)
    low = 0.0 if driver is not None and scene.warms(driver) else -np.inf
    unit = "W" if driver is None else f"W per {driver.text}"
    numbers = tuple(Number(f"heat_{each}", unit, 0.0, scale=scene.conductance(each) / size, low=low) for each in places)
    return Heat(places, numbers, driver)
