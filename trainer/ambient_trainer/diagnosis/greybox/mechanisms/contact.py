"""A body of its own temperature holds on to a node for a while: a hand, a table, a pocket."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ambient_trainer.data.trace import Array
from ambient_trainer.diagnosis.greybox.model import Mechanism, Number
from ambient_trainer.diagnosis.greybox.network import Network
from ambient_trainer.diagnosis.greybox.scene import Scene
from ambient_trainer.diagnosis.record import Record

_BODY_DEGC = 33.0
"""Of a hand."""


@dataclass(frozen=True)
class Contact(Mechanism):
    """A conductance to a body, and the body's temperature, within a window."""

    cause = "contact"
    noun = "the contact with a body of its own temperature"

    def apply(self, network: Network, values: Array, record: Record) -> None:
        conductance = values[:, :1, None] * self.weight(record)
        network.vary([network.index(self.places[0])], conductance, values[:, 1:2, None])

    def probes(self) -> Sequence[Sequence[float]]:
        return [[1e-3 * self.numbers[0].value, self.numbers[1].value]]

    def started(self, amounts: Sequence[float]) -> Mechanism | None:
        share = float(np.clip(1e-3 * amounts[0], 0.05, 3.0))
        return self.with_values([share * self.numbers[0].value, self.numbers[1].value])


def beside(scene: Scene, placed: Mechanism) -> Iterator[Mechanism]:
    """A contact in the window in which heat into one node explains something."""
    if len(placed.places) != 1 or placed.cause != "heat_source":
        return
    place = placed.places[0]
    conductance = Number(f"G_{place}_body", "W/K", scene.conductance(place), log=True)
    body = Number(f"body_{place}", "degC", _BODY_DEGC, low=-60.0, high=150.0)
    yield Contact((place,), (conductance, body), None, placed.onset_s, placed.end_s)
