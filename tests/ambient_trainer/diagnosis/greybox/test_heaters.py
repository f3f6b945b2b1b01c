"""Heaters of several bodies: each at its own place, unless all follow one of them, or one body warms another."""

from types import SimpleNamespace

import numpy as np
import pytest

from ambient_trainer.circuits.circuit import Circuit
from ambient_trainer.data.trace import Trace
from ambient_trainer.diagnosis.diagnose import diagnose
from ambient_trainer.diagnosis.greybox.choice import Limits, SelectionStep, choose
from ambient_trainer.diagnosis.greybox.conducted import conducted
from ambient_trainer.diagnosis.greybox.context import Context
from ambient_trainer.diagnosis.greybox.expression import Expression
from ambient_trainer.diagnosis.greybox.mechanisms import heat
from ambient_trainer.diagnosis.greybox.model import GreyBox
from ambient_trainer.diagnosis.greybox.pairs import fit_separately
from ambient_trainer.diagnosis.greybox.screening import screen
from ambient_trainer.diagnosis.greybox.stepwise import bare_fit
from ambient_trainer.diagnosis.greybox.trials import fit_candidates
from ambient_trainer.diagnosis.record import records

from .test_places import PAIR, TRIO
from .test_unlogged_room import TIME_S, in_a_room

PERIOD_S, SAMPLES, SUBSTEPS = 5.0, 400, 10


def warmed(seed: int, into: tuple[str, str]) -> Trace:
    """Two bodies that lose heat by free convection, with a controller each; ``into`` names the heater of each body."""
    draw = np.random.default_rng(seed)
    held_degC, degC, rows = draw.uniform([130, 90], [160, 110]), np.full(2, 25.0), []
    for _ in range(SAMPLES):
        share = np.clip(0.01 * (held_degC - degC + draw.normal(0, 2.0, 2)) + [0.4, 0.45], 0.0, 1.0)
        rows.append([*degC, *share])
        power_W = [{"one": share[0], "other": share[1]}[each] for each in into] * np.array([50.0, 90.0])
        for _ in range(SUBSTEPS):
            loss_W = np.array([0.06, 0.2]) * np.maximum(degC - 25.0, 0.0) ** 1.25
            degC = degC + PERIOD_S / SUBSTEPS * (power_W - loss_W) / np.array([25.0, 300.0])
    read, shares = np.split(np.array(rows).T, 2)
    read = read + draw.normal(0, 0.2, read.shape)
    columns = dict(zip(("fast_degC", "slow_degC", "one_frac", "other_frac"), (*read, *shares)))
    return Trace("heated", PERIOD_S * np.arange(SAMPLES), {**columns, "ambient_degC": np.full(SAMPLES, 25.0)})


def at_all(trace: Trace, driver: str, circuit: Circuit = PAIR) -> SelectionStep:
    """The step that has chosen heat by one column at all bodies."""
    bodies = tuple(each.name for each in circuit.states)
    bare = bare_fit(GreyBox.of(circuit), records(trace, circuit.inputs, [f"{each}_degC" for each in bodies], PERIOD_S))
    by_one = [each for each in heat.candidates(Context(bare)) if each.key == ("heat_source", bodies, driver)]
    trials = fit_candidates(bare, screen(Context(bare), lambda context, columns: iter(by_one)), lambda *done: None)
    chosen = choose(bare, [each for each in trials if each.mechanism.places == bodies], 0.0)
    return SelectionStep(bare, chosen, tuple(trials), 1)


def keys(steps: list[SelectionStep]) -> list[tuple[str, tuple[str, ...], str]]:
    return sorted(each.chosen.mechanism.key for each in steps)


@pytest.mark.parametrize("into", [("one", "other"), ("one", "one")])
def test_each_of_two_heaters_is_told_from_one_of_both(into, seed):
    expected = [("heat_source", ("fast",), "one_frac"), ("heat_source", ("slow",), "other_frac")]
    step = at_all(warmed(seed, into), "one_frac")
    assert keys(fit_separately(step, Limits())) == (expected if into == ("one", "other") else []), seed


def warmed_by_a_path(seed: int, power_W=(50.0, 0.0), loss_W_K=(0.2, 0.4), heat_J_K=(25.0, 100.0)) -> Trace:
    """Bodies in a room, some of them heated; what joins the last two conducts better when it is warm."""
    draw, degC, rows = np.random.default_rng(seed), np.full(len(power_W), 25.0), []
    shares = draw.uniform(0, 1, 20).repeat(SAMPLES // 20)
    between_W_K = np.append(np.zeros(len(power_W) - 2), draw.uniform(0.2, 0.4))
    for share in shares:
        rows.append(degC)
        for _ in range(SUBSTEPS):
            flow_W = between_W_K * (1 + 0.001 * (degC[1:] + degC[:-1])) * -np.diff(degC)
            into_W = np.array(power_W) * share - np.diff(flow_W, prepend=0.0, append=0.0)
            degC = degC + PERIOD_S / SUBSTEPS * (into_W - np.array(loss_W_K) * (degC - 25.0)) / np.array(heat_J_K)
    read = np.array(rows).T + draw.normal(0, 0.2, (len(power_W), SAMPLES))
    columns = {f"{name}_degC": row for name, row in zip(("fast", "slow", "other"), read)}
    columns |= {"heater_frac": shares, "ambient_degC": np.full(SAMPLES, 25.0)}
    return Trace("heated", PERIOD_S * np.arange(SAMPLES), columns)


def test_what_is_warmed_by_another_body_has_no_heater_of_its_own(seed):
    expected = [("heat_source", ("fast",), "heater_frac"), ("path", ("fast-slow",), "")]
    assert keys(conducted(at_all(warmed_by_a_path(seed), "heater_frac"))) == expected, seed
    assert conducted(at_all(warmed(seed, ("one", "one")), "one_frac")) == [], seed


def test_of_three_bodies_two_have_a_heater_and_one_warms_the_third(seed):
    trace = warmed_by_a_path(seed, (50.0, 40.0, 0.0), (0.2, 0.15, 0.3), (25.0, 60.0, 100.0))
    heaters = [("heat_source", (each,), "heater_frac") for each in ("fast", "slow")]
    assert keys(conducted(at_all(trace, "heater_frac", TRIO))) == [*heaters, ("path", ("slow-other",), "")], seed


def test_a_body_with_a_heater_of_its_own_name_is_warmed_by_no_path(seed):
    """As a printer's bed: both heaters go on at once."""
    trace = warmed_by_a_path(seed)
    shares = trace.columns.pop("heater_frac")
    own = np.clip(shares + np.random.default_rng(seed).normal(0, 0.1, SAMPLES), 0.0, 1.0)
    trace.columns.update(fast_heater_frac=shares, slow_heater_frac=own)
    assert conducted(at_all(trace, "fast_heater_frac")) == [], seed


@pytest.mark.parametrize(("node", "has"), [("bed", True), ("room2", True), ("room3", False), ("lid", False)])
def test_a_heater_is_named_after_its_body_and_number(node, has):
    others = ["bed_heater_frac", "room1_heater_W", "room2_heater_W", "lid_heater_degC", "lid_open_frac"]
    assert Context.has_a_heater(SimpleNamespace(columns=others), node, Expression("room1_heater_W")) == has


def test_a_heater_that_was_on_once_for_a_moment_is_a_driver(circuit, seed):
    """As where an engineer looks at an answer to a pulse: of all samples five in nine hundred."""
    draw, heater = np.random.default_rng(seed), np.zeros(len(TIME_S))
    at = draw.integers(100, 600)
    heater[at : at + 5] = 0.3, 1.0, 1.0, 1.0, 0.6

    def flow_W(now_s, degC):
        return 30 * np.interp(now_s, TIME_S, heater) - 0.1 * (degC - 25.0)

    trace = in_a_room(flow_W, draw, [draw.uniform(25, 35)], columns={"heater_frac": heater})
    verdict = diagnose(circuit, [trace]).verdict_cause
    assert (verdict.name, verdict.signal) == ("heat_source", "heater_frac"), seed
