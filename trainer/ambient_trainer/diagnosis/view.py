"""A record beside its simulation: every node's temperature, what the sensors should read, and the residual."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ambient_trainer.circuits.circuit import AMBIENT
from ambient_trainer.diagnosis.forward import REFERENCE_SENSOR
from ambient_trainer.diagnosis.plant import Plant
from ambient_trainer.diagnosis.record import Record

Array = NDArray[np.float64]

_PULL = 1.0
"""Tenths of a degree of residual that remember tens of samples, beside the degrees by which a start may be off."""


@dataclass(frozen=True)
class View:
    """``nodes_degC`` (n, N) is measured where a sensor is trusted, else simulated.

    ``truth_degC`` (s, N) is what each sensor should read, ``error_degC`` (s, N) what the model's sensor faults add;
    ``starts`` (n, s, N) is what each initial state leaves in the sensors: where a run began is never known.
    """

    plant: Plant
    record: Record
    nodes_degC: Array
    truth_degC: Array
    error_degC: Array
    starts: Array
    start: Array
    """The initial states found, (n,)."""
    model_degC: Array
    """Every node as the model has it, (n, N)."""

    @staticmethod
    def bare(plant: Plant, record: Record) -> View:
        """No more than what terms need to know of a record: its signals and inputs."""
        empty = np.zeros((0, 0))
        return View(plant, record, empty, empty, empty, empty, np.zeros(0), empty)

    @property
    def simulated_degC(self) -> Array:
        """What the sensors read by the model, (s, N)."""
        return np.asarray(self.truth_degC + self.error_degC)

    @property
    def ambient_degC(self) -> Array:
        """The prescribed ambient, (N,); zero where the circuit has none: nothing is then joined to it."""
        column = f"{REFERENCE_SENSOR}_degC"
        inputs = self.plant.circuit.inputs
        return self.record.inputs[inputs.index(column)] if column in inputs else np.zeros(self.record.samples)

    @property
    def residual_degC(self) -> Array:
        """Measured less simulated, (s, N), NaN where nothing was measured."""
        return np.asarray(self.record.sensors - self.simulated_degC)

    @property
    def signals(self) -> Mapping[str, Array]:
        """Every logged column that is no temperature, by name."""
        return {name: row for name, row in self.record.signals.items() if not name.endswith("_degC")}

    def signal(self, name: str) -> Array:
        """A logged signal, (N,); one that this record lacks was off."""
        return self.record.signals.get(name, np.zeros(self.record.samples))

    @property
    def ones(self) -> Array:
        """A weight that is always one, (N,)."""
        return np.ones(self.record.samples)


def conductances_to_ambient(plant: Plant) -> Array:
    """Per node its conductance to the ambient in W/K, (n,); zero where no edge leads there."""
    found = dict.fromkeys(plant.nodes, 0.0)
    for node, resistance in plant.circuit.to_ambient(plant.circuit.states):
        found[node] += 1.0 / plant.values[resistance]
    return np.array([found[name] for name in plant.nodes])


def joined(plant: Plant) -> set[frozenset[str]]:
    """The pairs of nodes between which the circuit has an edge."""
    return {frozenset(edge.between) for edge in plant.circuit.edges if AMBIENT not in edge.between}


def fitted_start(starts: Array, left: Array, expected: Array) -> Array:
    """The initial states (n,) that explain most of ``left`` (s, N), regularised towards those ``expected`` (n,).

    The start of a node without a sensor is hardly determined: without regularisation it may explain other things.
    """
    # neither does a trial that runs away
    known = np.isfinite(left)
    columns = starts[:, known]
    system = columns @ columns.T + _PULL * np.eye(len(starts))
    return np.asarray(expected + np.linalg.solve(system, columns @ (left[known] - expected @ columns)))


def expected_start(plant: Plant, record: Record) -> Array:
    """The start of a run by its first readings, (n,); for a node without a sensor their mean."""
    first = np.array([row[~np.isnan(row)][0] if (~np.isnan(row)).any() else np.nan for row in record.sensors])
    result = np.full(len(plant.nodes), np.nanmean(first) if (~np.isnan(first)).any() else 0.0)
    result[plant.reads] = np.where(np.isnan(first), result[plant.reads], first)
    return result


def with_measured(plant: Plant, record: Record, nodes_degC: Array, trusted: frozenset[int]) -> Array:
    """``nodes_degC`` with the readings of trusted sensors, and the nodes without one as those drive them."""
    result = nodes_degC.copy()
    known = np.zeros(len(nodes_degC), dtype=bool)
    for sensor, node in enumerate(plant.reads):
        if sensor in trusted:
            read = record.sensors[sensor]
            result[node] = np.where(np.isnan(read), result[node], read)
            known[node] = True
    if known.all() or not known.any():
        return result
    hidden = ~known
    drive = plant.A[np.ix_(hidden, known)] @ result[known] + plant.B[hidden] @ record.inputs
    part = plant.part(hidden)
    at_rest = part.V @ part.modal(part.W @ drive)
    left = (part.W @ nodes_degC[hidden, 0])[:, None] * part.modal_decay(record.samples)
    result[hidden] = at_rest + part.V @ left
    return result
