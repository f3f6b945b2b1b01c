"""The closed loop of heat and temperature against the nonlinear system, finely integrated, and against whole runs."""

from __future__ import annotations

import numpy as np
import pytest

from ambient_trainer.diagnosis.closed_loop import Loop, Part, closed_loop
from ambient_trainer.diagnosis.model import heat_parts
from ambient_trainer.diagnosis.terms import HeatTerm, into

MOST_STEPS = 12


def _settled(world, nodes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Newton's steps from ``nodes`` until nothing moves: what is added, and what follows the start."""
    plant, parts, air = (
        world.model.plant,
        heat_parts(world.model, world.model.plant, world.record),
        world.record.inputs[0],
    )
    decays = plant.decays(world.record.samples)
    for _ in range(MOST_STEPS):
        added, along = closed_loop(plant, parts, nodes, air, world.plain_degC, decays)
        last, nodes = nodes, world.plain_degC + added
        if np.abs(nodes - last).max() < 1e-9:
            return added, along
    raise AssertionError("Newton's steps do not settle")


def test_what_is_added_is_what_its_own_heat_makes(world) -> None:
    """Exactly: the modal filters' answer to the heat at the very temperatures that it leads to."""
    added, _ = _settled(world, world.plain_degC)
    plant, nodes = world.model.plant, world.plain_degC + added
    heat = sum(
        each.weight * each.term.value(nodes, world.record.inputs[0], plant.period_s, each.onset)
        for each in heat_parts(world.model, plant, world.record)
    )
    again = sum(plant.respond(node, heat[node]) for node in range(3))
    np.testing.assert_allclose(added, again, atol=1e-7)


@pytest.mark.parametrize("world", ["coupling"], indirect=True)
def test_heat_that_follows_nothing_is_that_of_the_plain_circuit(world) -> None:
    plant, air = world.model.plant, world.record.inputs[0]
    on = (np.arange(len(air)) % 60 > 30) * 0.7
    parts = [Part(on, HeatTerm(on, into(2, 3, lambda nodes, outside: np.ones_like(outside))), None)]
    assert Loop.about(plant, parts, world.nodes_degC, air) is None
    along = plant.decays(len(air))
    added, same = closed_loop(plant, parts, world.nodes_degC, air, world.plain_degC, along)
    assert same is along
    time_s = plant.period_s * np.arange(len(air))
    still = np.zeros_like(world.record.inputs)
    wanted = world.chain.integrated(
        still, np.zeros(3), lambda t, x, outside: np.array([0, 0, np.interp(t, time_s, on) / 40])
    )
    np.testing.assert_allclose(added, wanted, atol=1e-6)


@pytest.mark.parametrize("world", ["coupling"], indirect=True)
def test_a_signal_weighs_the_feedback(world) -> None:
    """A loss that goes with a ramp, and another node's constant heat, at once: Kirchhoff's law with both."""
    plant, air = world.model.plant, world.record.inputs[0]
    ramp, time_s = np.linspace(0.0, 2.0, len(air)), plant.period_s * np.arange(len(air))
    lost = HeatTerm(ramp, into(2, 3, lambda nodes, outside: (outside - nodes[2]) / 15))
    given = HeatTerm(np.ones_like(ramp), into(0, 3, lambda nodes, outside: np.full_like(outside, 0.3)))
    parts = [Part(ramp, lost, None), Part(np.ones_like(ramp), given, None)]
    loop = Loop.about(plant, parts, world.nodes_degC, air)
    assert loop is not None
    # this heat is a line of the temperatures: one step from anywhere is exact
    added, _ = loop.both(world.nodes_degC - world.plain_degC, np.empty((0, *world.nodes_degC.shape)))
    wanted = world.chain.integrated(
        world.record.inputs, world.start_degC,
        lambda t, x, outside: np.array([0.03, 0.0, np.interp(t, time_s, ramp) * (outside - x[2]) / 600]),
    )  # fmt: skip
    np.testing.assert_allclose(world.plain_degC + added, wanted, atol=0.01)
