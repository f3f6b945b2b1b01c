"""Devices of few nodes with known values, and what a search would have chosen for them."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest

from ambient_trainer.circuits.circuit import Circuit, Edge, Node, Parameter, Source
from ambient_trainer.diagnosis.candidate import Candidate
from ambient_trainer.diagnosis.causes import all_candidates
from ambient_trainer.diagnosis.experiment.difference import Difference, Hypothesis, Limits, largest_difference
from ambient_trainer.diagnosis.experiment.plan import Intervention, bench_of, plans
from ambient_trainer.diagnosis.experiment.proposal import LONGEST_S
from ambient_trainer.diagnosis.fit import FitResult
from ambient_trainer.diagnosis.forward import forward
from ambient_trainer.diagnosis.gain import Blocks
from ambient_trainer.diagnosis.model import Effect, Model, view
from ambient_trainer.diagnosis.plant import Plant
from ambient_trainer.diagnosis.record import Record
from ambient_trainer.diagnosis.result import Cause, Gain
from ambient_trainer.diagnosis.selection import Selection, SelectionStep, Trial
from ambient_trainer.diagnosis.setting import setting_of
from ambient_trainer.estimation.noise import ORDER, Noise

PERIOD_S, SAMPLES = 10.0, 720
GAIN = Gain(1.0, 0.5, (0.4, 0.6), 1e-6)


def circuit(nodes: dict[str, float], edges: dict[tuple[str, str], float]) -> Circuit:
    """Nodes with capacitances in J/K, all read; edges with resistances in K/W; ``power_W`` into the first."""
    first = next(iter(nodes))
    fixed = {f"C_{name}": value for name, value in nodes.items()}
    fixed |= {f"R_{one}_{other}": value for (one, other), value in edges.items()} | {"share": 1.0}
    return forward(
        Circuit(
            "made", "", "temperature", "first-order",
            (*(Node(name, f"C_{name}", name) for name in nodes), Node("ambient", None, "ambient")),
            tuple(Edge(between, f"R_{between[0]}_{between[1]}") for between in edges),
            (Source(first, "power_W", "share"),), (),
            tuple(Parameter(name, "", value, value / 10, value * 10, False) for name, value in fixed.items()),
        )
    )  # fmt: skip


def plant(nodes: dict[str, float], edges: dict[tuple[str, str], float]) -> Plant:
    made = circuit(nodes, edges)
    return Plant.of(made, {each.name: each.initial for each in made.parameters}, PERIOD_S)


@pytest.fixture
def single() -> Plant:
    """100 J/K behind 10 K/W: a time constant of 1000 s."""
    return plant({"board": 100.0}, {("board", "ambient"): 10.0})


@pytest.fixture
def chain() -> Plant:
    """chip - board - case - ambient."""
    return plant(
        {"chip": 5.0, "board": 30.0, "case": 60.0},
        {("chip", "board"): 6.0, ("board", "case"): 4.0, ("case", "ambient"): 8.0},
    )


def record(of: Plant) -> Record:
    time_s = PERIOD_S * np.arange(SAMPLES)
    power = 2.0 * (time_s % 2400 > 1200)
    radio = 1.0 * (time_s % 3100 > 2000)
    ambient = 20.0 + 3.0 * np.sin(2 * np.pi * time_s / 2400)
    inputs = np.array([{"ambient_degC": ambient, "power_W": power}[name] for name in of.circuit.inputs])
    rest = Record(PERIOD_S, time_s, inputs, np.full((len(of.reads), SAMPLES), np.nan), {})
    readings = 20.0 + (of.forced(inputs - inputs[:, :1]))[of.reads]
    return replace(rest, sensors=readings, signals={"power_W": power, "radio_on": radio, "ambient_degC": ambient})


def every_candidate(of: Plant) -> list[Candidate]:
    """All that the device's records allow, and every sensor could have stood still besides."""
    found = setting_of(Model(of), (view(Model(of), record(of)),))
    stuck = replace(found, flat=((None, None),) * len(of.reads))
    return [*all_candidates(found), *all_candidates(stuck)]


@pytest.fixture(scope="session")
def candidates() -> Callable[[Plant], list[Candidate]]:
    return every_candidate


Makes = Callable[..., Effect]


@pytest.fixture(scope="session")
def effect() -> Makes:
    return made_effect


def made_effect(
    of: Plant,
    cause: Cause,
    values: Sequence[float],
    onset_s: float | None = None,
    end_s: float | None = None,
    shape: float | None = None,
) -> Effect:
    """The cause's own candidate at ``values``; of several shapes the first, reshaped."""
    found: Candidate = next(
        each for each in every_candidate(of) if each.cause == cause and len(each.fixed) == len(values)
    )
    if shape is not None:
        assert found.reshaped is not None
        found = found.reshaped(shape)
    return Effect(found, onset_s, end_s, np.array(values), np.eye(len(values)))


def noise(of: Plant, deviation_degC: float) -> Noise:
    count = len(of.reads)
    return Noise(np.zeros((count, ORDER)), np.full(count, deviation_degC), np.full(count, deviation_degC))


def blocks(square: float, uneven: float = 0.0) -> Blocks:
    """Two blocks, so uneven that a larger square lies surely behind."""
    return Blocks(np.array([square + uneven, square - uneven]), np.ones((2, 1)), np.ones((2, 1)))


Chooses = Callable[..., Selection]


@pytest.fixture
def chosen() -> Chooses:
    """What a search would have found: of the effects the first, with the others as its rivals."""

    def make(of: Plant, deviation_degC: float, *effects: Effect, taken: bool = True, rivals: bool = True) -> Selection:
        own = record(of)
        plain = FitResult(Model(of), (view(Model(of), own),), (), 1.0)
        trials = tuple(
            Trial(each, replace(plain, model=Model(of, (each,))), blocks(10.0 * (1 + index**2), index), GAIN, 1.0, 1.0)
            for index, each in enumerate(effects)
        )
        choice = SelectionStep(
            trials[0] if taken and trials else None, trials[1:] if rivals else (), trials, 100, blocks(1000.0)
        )
        final = trials[0].fitted if taken and trials else plain
        return Selection((choice,), plain, final, noise(of, deviation_degC), ())

    return make


@pytest.fixture
def differing(chosen: Chooses) -> Callable[..., Difference]:
    """The soonest difference between two effects, or an effect and none."""

    def make(
        of: Plant, deviation_degC: float, one: Effect, other: Effect | None, hottest_degC: float = 100.0
    ) -> Difference:
        found = chosen(of, deviation_degC, one)
        bench = bench_of(found.plain.views, [])
        facts = Limits(0.0, PERIOD_S * SAMPLES, LONGEST_S, (-40.0, hottest_degC), found.noise)
        first, second = (Hypothesis(Model(of, () if each is None else (each,)), each) for each in (one, other))
        return largest_difference(first, [second], plans(bench, Intervention.LEFT), bench, facts)

    return make
