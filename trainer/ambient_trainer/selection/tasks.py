"""What is computed many times, each a pure function of a key and of what all keys share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ambient_trainer.data.grid import Segment
from ambient_trainer.estimation.blocks import Block
from ambient_trainer.estimation.circuit_structure import CircuitStructure
from ambient_trainer.estimation.free_filter import FreeFilter
from ambient_trainer.estimation.held_out import Refitted, Spending, refitted
from ambient_trainer.selection.forward import best_sets
from ambient_trainer.selection.grams import Grams, Sensors, gathered
from ambient_trainer.selection.screen import Sensor
from ambient_trainer.selection.wiring import Wiring, circuit_of

_FILTER = Spending(starts=2, whole=200, without=12)
_CIRCUIT = Spending(starts=1, whole=60, without=5)
"""Of hundreds: where a wiring leaves a direction open a search would creep along it for long."""


def bank_key(poles_s: Sequence[float]) -> str:
    """A bank as a key."""
    return ",".join(map(repr, poles_s))


def key_of(candidate: Sensors) -> str:
    """A candidate as a key."""
    return ",".join(map(str, candidate))


def candidate_of(key: str) -> Sensors:
    """The inverse of :func:`key_of`."""
    return tuple(map(int, key.split(",")))


@dataclass(frozen=True)
class BankScores:
    """The held-out RMSE in degC of the best few sensors over a bank, its key."""

    segments: tuple[Segment, ...]
    blocks: tuple[Block, ...]
    sensors: tuple[Sensor, ...]
    tolerance_degC: float
    most: int
    name: str = "bank"

    def __call__(self, keys: Sequence[str]) -> list[float]:
        """The error a bank."""
        return [self._score(tuple(map(float, key.split(",")))) for key in keys]

    def _score(self, poles_s: tuple[float, ...]) -> float:
        task = SetScores(gathered(self.segments, self.blocks, self.sensors, poles_s, self.tolerance_degC))

        def score(candidates: Sequence[Sensors]) -> list[float]:
            return task([key_of(each) for each in candidates]) if candidates else []

        best = best_sets(range(len(self.sensors)), self.most, score)
        return min(score([each])[0] for each in best)


@dataclass(frozen=True)
class SetScores:
    """The held-out RMSE in degC of a set of sensors, its key, over a bank."""

    grams: Grams

    @property
    def name(self) -> str:
        """Of the task, which goes with the bank."""
        return f"set {bank_key(self.grams.poles_s)}"

    def __call__(self, keys: Sequence[str]) -> list[float]:
        """All keys name sets of one size."""
        squares = self.grams.squares([candidate_of(key) for key in keys])
        found: list[float] = np.sqrt(squares.sum(axis=1) / self.grams.samples.sum()).tolist()
        return found


@dataclass(frozen=True)
class FreeFits:
    """The free filter of a set of sensors, its key, and its squares by block; ``segments`` hold all sensors."""

    segments: tuple[Segment, ...]
    blocks: tuple[Block, ...]
    order: int

    @property
    def name(self) -> str:
        """Of the task."""
        return f"free-{self.order}"

    def __call__(self, keys: Sequence[str]) -> list[dict[str, Any]]:
        """A fit a key."""
        return [self._fit(candidate_of(key)) for key in keys]

    def structure(self, candidate: Sensors) -> FreeFilter:
        """The filter over the readings of these sensors."""
        return FreeFilter(self.order, rows_of(self.segments, candidate))

    def _fit(self, candidate: Sensors) -> dict[str, Any]:
        return _kept(refitted(self.structure(candidate), self.blocks, _FILTER))


@dataclass(frozen=True)
class WiringFits:
    """The circuit of a wiring, its key, and its squares by block; ``segments`` hold ``sensors`` in this order."""

    segments: tuple[Segment, ...]
    blocks: tuple[Block, ...]
    sensors: tuple[str, ...]
    tau_s: tuple[float, ...]
    name: str = "circuit"

    def __call__(self, keys: Sequence[str]) -> list[dict[str, Any]]:
        """A fit a key."""
        return [_kept(self._fit(Wiring.of_text(key))) for key in keys]

    def structure(self, wiring: Wiring) -> CircuitStructure:
        """The circuit over the readings of its sensors."""
        circuit = circuit_of(wiring, self.tau_s, "candidate", "candidate")
        # a circuit orders its inputs by its nodes
        rows = [self.sensors.index(each.removesuffix("_degC")) for each in circuit.inputs]
        return CircuitStructure(circuit, rows_of(self.segments, rows))

    def _fit(self, wiring: Wiring) -> Refitted:
        return refitted(self.structure(wiring), self.blocks, _CIRCUIT)


def rows_of(segments: Sequence[Segment], rows: Sequence[int]) -> list[Segment]:
    """The segments with these of their inputs."""
    return [Segment(each.period_s, each.inputs[list(rows)], each.outputs) for each in segments]


def wiring_error(value: dict[str, Any], samples: float) -> float:
    """The held-out RMSE in degC of what a fit left."""
    return float(np.sqrt(sum(value["squares"]) / samples))


def _kept(found: Refitted) -> dict[str, Any]:
    best = found.solution
    return {"theta": best.theta.tolist(), "beta": best.beta.tolist(), "squares": list(found.squares)}
