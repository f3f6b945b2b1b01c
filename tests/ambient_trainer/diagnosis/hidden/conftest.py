"""Runs with something hidden in them: of the simulated phone, and of a box whose physics stand here.

A number makes a run and what is hidden in it; the diagnosis gets traces, a circuit and known-good runs, nothing else.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from threadpoolctl import threadpool_limits

from ambient_studies.discovery.cases import CAUSES, Case, baselines, simulated
from ambient_studies.discovery.runner import Bench, size_in_noise
from ambient_studies.discovery.score import Scored, score
from ambient_trainer.circuits.circuit import Circuit
from ambient_trainer.circuits.schema import load_circuit
from ambient_trainer.data.trace import Trace
from ambient_trainer.diagnosis.diagnose import diagnose_trained
from ambient_trainer.diagnosis.forward import forward
from ambient_trainer.diagnosis.result import Diagnosis
from ambient_trainer.diagnosis.selection import known_good_model
from ambient_trainer.diagnosis.training import train_on_baselines
from ambient_trainer.simulator.effects.draw import draw_hidden
from ambient_trainer.simulator.effects.runs import Simulated
from ambient_trainer.simulator.effects.signals import SIGNALS
from ambient_trainer.simulator.scenario import load_scenario

PERIOD_S = 20.0
"""Of the phone's records: half as many samples as a diagnosis takes by itself, for half the time."""
SCALE = 2.5
TAUGHT_BY = 1
BOX = Path(__file__).parents[3] / "data" / "circuits" / "box.yaml"
BOX_SAMPLES, BOX_PERIOD_S = 1080, 10.0


@pytest.fixture(scope="session")
def bench() -> Bench:
    """The phone's circuit, trained by three known-good runs."""
    circuit = load_circuit("phone")
    known_good = baselines(TAUGHT_BY)
    with threadpool_limits(1):
        trained = train_on_baselines(forward(circuit), known_good, PERIOD_S, known_good_model, None)
    return Bench(circuit, trained, PERIOD_S, tuple(trace.path for trace in known_good))


@dataclass(frozen=True)
class Told:
    """What was hidden in a run, what was said of it, and how that compares."""

    run: Simulated
    said: Diagnosis
    scored: Scored


@pytest.fixture(scope="session")
def told_of(bench: Bench) -> Callable[..., Told]:
    """Diagnoses a run in which effects of some causes are hidden, all else drawn from ``seed``."""

    def tell(seed: int, *causes: str, **given: object) -> Told:
        random = np.random.default_rng([seed, *(CAUSES.index(cause) for cause in causes)])
        duration_s = load_scenario("5").duration_s
        hidden = tuple(draw_hidden(random, cause, duration_s, SCALE, **given) for cause in causes)
        idle = [name for name in SIGNALS if name not in {effect.signal for effect in hidden}]
        decoys = sorted(str(name) for name in random.choice(idle, 2, replace=False))
        case = Case(seed, int(random.integers(2**31)), hidden, tuple(decoys))
        run = simulated([case])[0]
        with threadpool_limits(1):
            said = diagnose_trained(bench.trained, bench.circuit, [run.trace], bench.baselines, bench.period_s)
        return Told(run, said, score(run.truths, size_in_noise(bench, run), said, bench.circuit, 0.0))

    return tell


@pytest.fixture(scope="session")
def box() -> Circuit:
    """Three nodes in a row, as bare as a first guess: :func:`boxed` says what a real box may have besides."""
    return load_circuit(str(BOX))


@pytest.fixture(scope="session")
def boxed() -> Callable[..., Trace]:
    """Three hours of a box, integrated to 1e-6; by name what it has that its circuit lacks; in a room, or outdoors."""
    return _boxed


def _boxed(lacks: str, seed: int, room_degC: float | None = None) -> Trace:
    random = np.random.default_rng([seed, 7])
    time_s = BOX_PERIOD_S * np.arange(BOX_SAMPLES)
    jumps = np.where(random.random(BOX_SAMPLES) < 0.004, random.normal(0, 4, BOX_SAMPLES), 0.0)
    air = 18 + 5 * np.sin(time_s / random.uniform(1500, 2500) + random.uniform(0, 6)) + np.cumsum(jumps)
    if room_degC is not None:
        air = np.full(BOX_SAMPLES, room_degC)
    power = _switched(random, 700) * random.uniform(2, 3) + _switched(random, 1500) * random.uniform(0.5, 1)
    radio, fan = _switched(random, 500), _switched(random, 900)
    current = _switched(random, 600) * random.uniform(1, 2) - _switched(random, 800) * random.uniform(0.5, 2)
    size = random.uniform(0.8, 1.3)
    true_degC = _integrated(lacks, size, np.array([air, power, radio, current]))
    read_degC = _read(lacks, size, true_degC) + 0.05 * random.standard_normal(true_degC.shape)
    logged = np.interp(time_s - 150 * size, time_s, air) if lacks == "clock_offset" else air
    columns = {
        "ambient_degC": logged + (0.02 * random.standard_normal(BOX_SAMPLES) if room_degC is None else 0.0),
        "chip_power_W": power,
        **dict(zip(("chip_degC", "board_degC", "shell_degC"), read_degC)),
        "radio_on": radio,
        "fan_on": fan,
        "battery_current_A": current,
    }
    return Trace(f"{lacks}-{seed}.csv", time_s, columns)


def _switched(random: np.random.Generator, typical_s: float) -> np.ndarray:
    row, index, on = np.zeros(BOX_SAMPLES), 0, bool(random.integers(2))
    while index < BOX_SAMPLES:
        lasting = int(random.uniform(0.5, 1.5) * typical_s / BOX_PERIOD_S)
        row[index : index + lasting] = on
        index, on = index + lasting, not on
    return row


def _integrated(lacks: str, size: float, inputs: np.ndarray) -> np.ndarray:
    """Chip, board and shell in degC, (3, samples); the inputs are straight lines between their samples."""

    def rates(nodes: np.ndarray, air: float, power: float, radio: float, current: float) -> list[float]:
        chip, board, shell, body = nodes
        difference = shell - air
        bent = (abs(difference) / 8) ** (0.35 * size) if lacks == "convection_law" else 1.0
        loss = (0.15 if lacks == "ambient_coupling" else 0.25) * difference * bent
        into_board, into_shell = 0.2 * (chip - board), 0.3 * (board - shell)
        past_the_board = 0.08 * size * (chip - shell) if lacks == "path" else 0.0
        into_body = 0.3 * size * (shell - body) if lacks == "thermal_mass" else 0.0
        from_radio = 0.6 * size * radio if lacks == "heat_source" else 0.0
        from_current = 0.35 * size * current**2 if lacks == "current_squared" else 0.0
        return [
            (power - into_board - past_the_board) / 8,
            (into_board - into_shell + from_current) / 30,
            (into_shell + past_the_board + from_radio - into_body - loss) / 80,
            into_body / 120,
        ]

    nodes = np.full(4, inputs[0, 0])
    found = [nodes]
    for now, then in zip(inputs.T[:-1], inputs.T[1:]):

        def within(passed_s: float, nodes: np.ndarray, now: np.ndarray = now, then: np.ndarray = then) -> list[float]:
            return rates(nodes, *(now + (then - now) * passed_s / BOX_PERIOD_S))

        nodes = solve_ivp(within, (0, BOX_PERIOD_S), nodes, method="DOP853", rtol=1e-6, atol=1e-6).y[:, -1]
        found.append(nodes)
    return np.array(found).T[:3]


def _read(lacks: str, size: float, true_degC: np.ndarray) -> np.ndarray:
    read = true_degC.copy()
    if lacks == "sensor_lag":
        share = 1 - np.exp(-BOX_PERIOD_S / (60 * size))
        for index in range(1, BOX_SAMPLES):
            read[0, index] = read[0, index - 1] + share * (true_degC[0, index] - read[0, index - 1])
    if lacks == "sensor_gain":
        read[1] = 25 + (1 + 0.12 * size) * (read[1] - 25)
    return read


@pytest.fixture
def with_columns() -> Callable[..., Trace]:
    """A trace with some of its columns changed."""
    return lambda trace, **columns: replace(trace, columns={**trace.columns, **columns})
