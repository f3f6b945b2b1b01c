"""A chain of three nodes, and its physics written down once more: an oracle that shares nothing with the package."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from ambient_trainer.circuits.circuit import Circuit, Parameter
from ambient_trainer.circuits.schema import load_circuit
from ambient_trainer.diagnosis.candidate import Candidate
from ambient_trainer.diagnosis.causes import all_candidates
from ambient_trainer.diagnosis.forward import forward
from ambient_trainer.diagnosis.model import Effect, Model, view
from ambient_trainer.diagnosis.plant import Plant
from ambient_trainer.diagnosis.record import Record
from ambient_trainer.diagnosis.setting import setting_of
from ambient_trainer.estimation.noise import Noise

Array = NDArray[np.float64]
Heat = Callable[[float, Array, float], Array]
"""Of the time, the whole state and the ambient to what comes to each state's derivative."""

PERIOD_S = 10.0
CHAIN = Path(__file__).parents[3] / "data" / "circuits" / "chain.yaml"
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

    def candidate(self, record: Record, cause: str, shape: float | None = None) -> Candidate:
        """The first candidate of this cause, with this shape where it has one."""
        model = self.model()
        found = all_candidates(setting_of(model, [view(model, record)]))
        first = next(each for each in found if str(each.cause) == cause)
        return first if shape is None or first.reshaped is None else first.reshaped(shape)

    def effect(
        self,
        record: Record,
        cause: str,
        values: Sequence[float],
        onset_s: float | None = None,
        end_s: float | None = None,
        shape: float | None = None,
    ) -> Effect:
        """An effect of that cause whose coefficients nobody is unsure of."""
        unsure = np.zeros((len(values) + 1,) * 2)
        return Effect(self.candidate(record, cause, shape), onset_s, end_s, np.array(values), unsure)

    def noise(self, deviation_degC: float = 0.05, sensors: int = 3) -> Noise:
        """White, of this deviation."""
        spread = np.full(sensors, deviation_degC)
        return Noise(np.zeros((sensors, 4)), spread, spread)


@pytest.fixture(scope="session")
def chain() -> Chain:
    """Three nodes in a row, each with a sensor, two joined to the ambient, the first heated by a logged power."""
    return Chain(forward(load_circuit(str(CHAIN))))


@pytest.fixture(scope="session")
def shared(chain: Chain) -> Chain:
    """The chain whose heater gives a share of its power that is looked for."""
    source = replace(chain.circuit.sources[0], share="share")
    parameters = (*chain.circuit.parameters, Parameter("share", "1", 0.6, 0.0, 2.0, free=True))
    return Chain(replace(chain.circuit, sources=(source,), parameters=parameters))


@dataclass(frozen=True)
class Case:
    """An effect whose heat follows temperatures, as physics and as the package says it.

    ``heat`` makes the physics of the effect's numbers and of what the circuit's parameters are; a body that it adds is
    a fourth state, which begins as warm as the board or, ``attached``, as the ambient.
    """

    cause: str
    values: tuple[float, ...]
    heat: Callable[..., Heat]
    onset_s: float | None = None
    end_s: float | None = None
    shape: float | None = None
    body: bool = False


def _between(t: float, onset_s: float | None, end_s: float | None) -> bool:
    return (onset_s is None or t >= onset_s) and (end_s is None or t < end_s)


def _coupling(values: Sequence[float], case: Case, circuit: Mapping[str, float]) -> Heat:
    G = values[0] / circuit["R_shell_ambient"] / circuit["C_shell"]
    return lambda t, x, air: np.array([0, 0, -G * (x[2] - air) * _between(t, case.onset_s, case.end_s)])


def _contact(values: Sequence[float], case: Case, circuit: Mapping[str, float]) -> Heat:
    G, offset = np.array(values) / circuit["C_shell"]
    return lambda t, x, air: np.array([0, 0, (G * (25.0 - x[2]) + offset) * _between(t, case.onset_s, case.end_s)])


def _convection(values: Sequence[float], case: Case, circuit: Mapping[str, float]) -> Heat:
    board, shell = (1.0 / circuit[f"R_{each}_ambient"] / circuit[f"C_{each}"] for each in ("board", "shell"))

    def heat(t: float, x: Array, air: float) -> Array:
        D = x - air
        return -np.array([0.0, board, shell]) * D * (values[0] * np.abs(D) + values[1])

    return heat


def _path(values: Sequence[float], case: Case, circuit: Mapping[str, float]) -> Heat:
    share = np.array([1.0 / circuit["C_chip"], 0.0, -1.0 / circuit["C_shell"]])
    return lambda t, x, air: values[0] * (x[2] - x[0]) * share


def _mass(values: Sequence[float], case: Case, circuit: Mapping[str, float]) -> Heat:
    share = np.array([0.0, -values[0] / circuit["C_board"], 0.0, 1.0 / float(case.shape or np.nan)])
    return lambda t, x, air: (x[1] - x[3]) * share * _between(t, case.onset_s, None)


CASES = {
    "coupling": Case("ambient_coupling at shell", (0.8,), _coupling),
    "coupling for a while": Case("ambient_coupling at shell", (0.8,), _coupling, 605.0, 1605.0),
    "contact": Case("contact at shell", (0.2, 0.2 * 11), _contact, 605.0, 1605.0),
    "convection": Case("convection_law", (0.04, -0.3), _convection),
    "path": Case("path at chip-shell", (1 / 15,), _path),
    "mass": Case("thermal_mass at board", (0.2,), _mass, shape=300.0, body=True),
    "mass that is attached": Case("thermal_mass at board", (0.2,), _mass, 605.0, shape=300.0, body=True),
}


@dataclass(frozen=True)
class World:
    """A case at work: the record without noise, its true nodes (3, N), and the model that says the same."""

    chain: Chain
    case: Case
    model: Model
    record: Record
    nodes_degC: Array
    start_degC: Array

    @property
    def effect(self) -> Effect:
        """The model's only effect."""
        return self.model.effects[0]

    @property
    def plain_degC(self) -> Array:
        """The nodes without the effect's heat, (3, N)."""
        decays = self.model.plant.decays(self.record.samples)
        return self.model.plant.forced(self.record.inputs) + np.einsum("i,ink->nk", self.start_degC, decays)

    def integrated(
        self,
        values: Sequence[float] | None = None,
        start_degC: Array | None = None,
        case: Case | None = None,
        **changed: float,
    ) -> Array:
        """The nodes (3, N) with other numbers, another start, or parameters of the circuit changed."""
        case = case or self.case
        start = self.start_degC if start_degC is None else start_degC
        acting = case.heat(case.values if values is None else values, case, {**VALUES, **changed})
        air, onset_s = self.record.inputs[0], case.onset_s
        drift = np.append(np.diff(air), 0.0) / self.chain.period_s

        def attached(t: float, x: Array, outside: float) -> Array:
            # until then the body lies in the air
            early = np.array([0.0, 0.0, 0.0, drift[int(t / self.chain.period_s)]])
            return acting(t, x, outside) if onset_s is None or t >= onset_s else early

        if not case.body:
            return self.chain.integrated(self.record.inputs, start, acting, **changed)
        start = np.append(start, start[1] if onset_s is None else air[0])
        return self.chain.integrated(self.record.inputs, start, attached, **changed)[:3]


@pytest.fixture(scope="session")
def world(request: pytest.FixtureRequest, chain: Chain) -> World:
    """The case whose name is given."""
    case = CASES[request.param]
    inputs, start = chain.inputs(240), np.array([32.0, 27.0, 23.0])
    empty = chain.record(inputs, np.full((3, 240), 25.0))
    effect = chain.effect(empty, case.cause, case.values, case.onset_s, case.end_s, case.shape)
    draft = World(chain, case, chain.model().with_effect(effect), empty, empty.sensors, start)
    nodes = draft.integrated()
    return World(chain, case, draft.model, chain.record(inputs, nodes), nodes, start)


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """A test of a world that names none is one of each."""
    named = any("world" in str(mark.args[0]) for mark in metafunc.definition.iter_markers("parametrize"))
    if "world" in metafunc.fixturenames and not named:
        metafunc.parametrize("world", list(CASES), indirect=True, scope="session")
