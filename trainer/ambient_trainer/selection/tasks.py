"""What is computed many times, each a pure function of a key and of what all keys share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ambient_trainer.data.grid import Segment
from ambient_trainer.estimation.circuit_structure import CircuitStructure
from ambient_trainer.estimation.free_filter import FreeFilter
from ambient_trainer.estimation.structure import Structure
from ambient_trainer.estimation.validation import Block, Spending, refitted
from ambient_trainer.selection.floating import best_sets
from ambient_trainer.selection.grams import Grams, Sensors, gathered
from ambient_trainer.selection.screen import Sensor
from ambient_trainer.selection.topology import Topology, circuit_of

_FILTER = Spending(starts=2, whole=200, without=12)
_CIRCUIT = Spending(starts=1, whole=60, without=5)
"""Of hundreds: where a topology leaves a direction open a search would creep along it for long."""


@dataclass(frozen=True)
class PoleScores:
    """The held-out RMSE in degC of the best few sensors over fixed poles, the key."""

    segments: tuple[Segment, ...]
    blocks: tuple[Block, ...]
    sensors: tuple[Sensor, ...]
    tolerance_degC: float
    most: int
    name: str = "poles"

    def __call__(self, keys: Sequence[tuple[float, ...]]) -> list[float]:
        """The error of each set of time constants in s."""
        return [self._score(key) for key in keys]

    def _score(self, poles_s: tuple[float, ...]) -> float:
        score = SetScores(gathered(self.segments, self.blocks, self.sensors, poles_s, self.tolerance_degC))
        return min(score([each])[0] for each in best_sets(range(len(self.sensors)), self.most, score))


@dataclass(frozen=True)
class SetScores:
    """The held-out RMSE in degC of a set of sensors, the key, over fixed poles."""

    grams: Grams

    @property
    def name(self) -> str:
        """Of the task, which goes with the poles."""
        return f"set {self.grams.poles_s}"

    def __call__(self, keys: Sequence[Sensors]) -> list[float]:
        """The error of each set; all are of one size."""
        if not keys:
            return []
        squares = self.grams.squares(keys)
        errors: list[float] = np.sqrt(squares.sum(axis=1) / self.grams.samples.sum()).tolist()
        return errors


@dataclass(frozen=True)
class FreeFits:
    """The free filter of a set of sensors, the key, and its squares by block; ``segments`` hold all sensors."""

    segments: tuple[Segment, ...]
    blocks: tuple[Block, ...]
    order: int

    @property
    def name(self) -> str:
        """Of the task."""
        return f"free-{self.order}"

    def __call__(self, keys: Sequence[Sensors]) -> list[dict[str, Any]]:
        """A fit a set."""
        return [_fit(self.structure(key), self.blocks, _FILTER) for key in keys]

    def structure(self, candidate: Sensors) -> FreeFilter:
        """The filter over the readings of these sensors."""
        return FreeFilter(self.order, rows_of(self.segments, candidate))


@dataclass(frozen=True)
class CircuitFits:
    """The circuit of a topology, the key, and its squares by block; ``segments`` hold ``sensors`` in this order."""

    segments: tuple[Segment, ...]
    blocks: tuple[Block, ...]
    sensors: tuple[str, ...]
    tau_s: tuple[float, ...]
    name: str = "circuit"

    def __call__(self, keys: Sequence[Topology]) -> list[dict[str, Any]]:
        """A fit a topology."""
        return [_fit(self.structure(key), self.blocks, _CIRCUIT) for key in keys]

    def structure(self, topology: Topology) -> CircuitStructure:
        """The circuit over the readings of its sensors."""
        circuit = circuit_of(topology, self.tau_s, "candidate", "candidate")
        # a circuit orders its inputs by its nodes
        rows = [self.sensors.index(each.removesuffix("_degC")) for each in circuit.inputs]
        return CircuitStructure(circuit, rows_of(self.segments, rows))


def rows_of(segments: Sequence[Segment], rows: Sequence[int]) -> list[Segment]:
    """The segments with these of their inputs."""
    return [Segment(each.period_s, each.inputs[list(rows)], each.outputs) for each in segments]


def _fit(structure: Structure, blocks: Sequence[Block], spending: Spending) -> dict[str, Any]:
    fit = refitted(structure, blocks, spending)
    return {
        "theta": fit.solution.theta.tolist(),
        "beta": fit.solution.beta.tolist(),
        "squares": list(fit.squares),
    }
