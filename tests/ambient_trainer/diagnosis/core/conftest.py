"""A chain of three nodes, and its physics written down once more: an oracle that shares nothing with the package."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from ambient_trainer.circuits.circuit import Circuit
from ambient_trainer.circuits.schema import parse_circuit
from ambient_trainer.diagnosis.extended import Model
from ambient_trainer.diagnosis.forward import forward
from ambient_trainer.diagnosis.noise import Noise
from ambient_trainer.diagnosis.plant import Plant
from ambient_trainer.diagnosis.record import Record

Array = NDArray[np.float64]
Heat = Callable[[float, Array, float], Array]
"""Of the time, the whole state and the ambient to what comes to each state's derivative."""

PERIOD_S = 10.0
TEXT = """
format: ambient-circuit
version: 1
name: chain
about: A heated chip, a board and a shell
form: temperature
nodes:
  chip: {capacitance: C_chip, sensor: chip}
  board: {capacitance: C_board, sensor: board}
  shell: {capacitance: C_shell, sensor: shell}
  ambient: {sensor: ambient}
edges:
  - {between: [chip, board], resistance: R_chip_board}
  - {between: [board, shell], resistance: R_board_shell}
  - {between: [board, ambient], resistance: R_board_ambient}
  - {between: [shell, ambient], resistance: R_shell_ambient}
sources:
  - {into: chip, signal: heater_W, share: 1.0}
outputs: sensors
parameters:
  C_chip: {unit: J/K, initial: 10, min: 2, max: 50}
  C_board: {unit: J/K, initial: 25, min: 5, max: 125}
  C_shell: {unit: J/K, initial: 40, min: 8, max: 200}
  R_chip_board: {unit: K/W, initial: 8, min: 1, max: 60}
  R_board_shell: {unit: K/W, initial: 12, min: 2, max: 80}
  R_board_ambient: {unit: K/W, initial: 30, min: 5, max: 200}
  R_shell_ambient: {unit: K/W, initial: 15, min: 3, max: 100}
"""
VALUES = {
    "C_chip": 10.0, "C_board": 25.0, "C_shell": 40.0,
    "R_chip_board": 8.0, "R_board_shell": 12.0, "R_board_ambient": 30.0, "R_shell_ambient": 15.0,
}  # fmt: skip


@dataclass(frozen=True)
class Chain:
    """The circuit, and the same thing as physics."""

    circuit: Circuit
    period_s: float = PERIOD_S

    def plant(self, **changed: float) -> Plant:
        """The plant at the true values, or with some changed."""
        values = {each.name: each.initial for each in self.circuit.parameters}
        return Plant.of(self.circuit, {**values, **changed}, self.period_s)

    def model(self, **changed: float) -> Model:
        """The plant with no effects."""
        return Model(self.plant(**changed))

    def inputs(self, samples: int, seed: int = 1) -> Array:
        """Ambient and heater, straight between samples: a slow drift, and switching with corners everywhere."""
        random = np.random.default_rng(seed)
        time_s = self.period_s * np.arange(samples)
        air = 20.0 + 4.0 * np.sin(time_s / 1500.0) + 0.3 * np.cos(time_s / 130.0)
        steps = random.uniform(0.0, 2.5, samples // 40 + 1)
        return np.stack([air, np.repeat(steps, 40)[:samples]])

    def balance(self, values: Mapping[str, float], nodes: Array, air: float, heater: float) -> Array:
        """dT/dt of the three nodes by Kirchhoff's law, in K/s."""
        chip, board, shell = nodes
        inner, outer = (chip - board) / values["R_chip_board"], (board - shell) / values["R_board_shell"]
        return np.array(
            [
                (heater - inner) / values["C_chip"],
                (inner - outer - (board - air) / values["R_board_ambient"]) / values["C_board"],
                (outer - (shell - air) / values["R_shell_ambient"]) / values["C_shell"],
            ]
        )

    def integrated(self, inputs: Array, start: Array, heat: Heat | None = None, **changed: float) -> Array:
        """The states (n, N) by Dormand and Prince's eighth order, sample by sample, inputs straight in between."""
        values, count = {**VALUES, **changed}, len(start)
        result = np.empty((count, inputs.shape[1]))
        result[:, 0] = start

        def slope(t: float, state: Array) -> Array:
            k = min(int(t / self.period_s), inputs.shape[1] - 2)
            air, heater = inputs[:, k] + (t / self.period_s - k) * (inputs[:, k + 1] - inputs[:, k])
            own = np.concatenate([self.balance(values, state[:3], air, heater), np.zeros(count - 3)])
            return own if heat is None else own + heat(t, state, air)

        for k in range(inputs.shape[1] - 1):
            span = (k * self.period_s, (k + 1) * self.period_s)
            solved = solve_ivp(slope, span, result[:, k], method="DOP853", rtol=1e-9, atol=1e-9, max_step=self.period_s)
            result[:, k + 1] = solved.y[:, -1]
        return result

    def record(self, inputs: Array, sensors: Array, **signals: Array) -> Record:
        """A record of these readings, from zero on."""
        time_s = self.period_s * np.arange(inputs.shape[1])
        logged = {"ambient_degC": inputs[0], "heater_W": inputs[1], **signals}
        return Record(self.period_s, time_s, inputs, sensors, logged)

    def noise(self, deviation_degC: float = 0.05, sensors: int = 3) -> Noise:
        """White, of this deviation."""
        spread = np.full(sensors, deviation_degC)
        return Noise(np.zeros((sensors, 4)), spread, spread)


@pytest.fixture(scope="session")
def chain() -> Chain:
    """Three nodes in a row, each with a sensor, two joined to the ambient, the first heated by a logged power."""
    return Chain(forward(parse_circuit(TEXT, "chain.yaml")))
