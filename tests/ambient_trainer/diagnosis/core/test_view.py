"""A record beside its simulation: where it began, what was read, and what nodes without a sensor were."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ambient_trainer.circuits.schema import parse_circuit
from ambient_trainer.diagnosis.forward import forward
from ambient_trainer.diagnosis.model import Model, view
from ambient_trainer.diagnosis.plant import Plant
from ambient_trainer.diagnosis.record import Record
from ambient_trainer.diagnosis.view import conductances_to_ambient, joined, with_measured

START = np.array([34.0, 27.0, 22.0])


@pytest.fixture(scope="module")
def blind(chain):
    """The same chain without a sensor on the board."""
    nodes = tuple(replace(node, sensor=None) if node.name == "board" else node for node in chain.circuit.nodes)
    return type(chain)(forward(replace(chain.circuit, nodes=nodes)))


def test_the_start_is_found(chain) -> None:
    inputs = chain.inputs(300)
    nodes = chain.integrated(inputs, START)
    seen = view(chain.model(), chain.record(inputs, nodes))
    np.testing.assert_allclose(seen.start, START, atol=1e-3)
    np.testing.assert_allclose(seen.residual_degC, 0.0, atol=1e-3)
    np.testing.assert_allclose(seen.simulated_degC, seen.truth_degC)


def test_a_start_that_sensors_hardly_see_is_still_found(chain, blind) -> None:
    inputs = chain.inputs(300)
    nodes = chain.integrated(inputs, START)
    seen = view(blind.model(), blind.record(inputs, nodes[[0, 2]]))
    np.testing.assert_allclose(seen.start, START, atol=0.3)
    np.testing.assert_allclose(seen.nodes_degC[:, 10:], nodes[:, 10:], atol=0.1)


def test_starts_are_what_an_initial_state_leaves(chain) -> None:
    inputs = chain.inputs(120)
    seen = view(chain.model(), chain.record(inputs, chain.integrated(inputs, START)))
    for node in range(3):
        left = chain.integrated(inputs, START + np.eye(3)[node]) - chain.integrated(inputs, START)
        np.testing.assert_allclose(seen.starts[node], left, atol=1e-7)


def test_missing_readings_take_the_simulation_and_leave_no_residual(chain) -> None:
    inputs = chain.inputs(200)
    nodes = chain.integrated(inputs, START)
    read = nodes + 0.5
    read[1, 50:80] = np.nan
    seen = view(chain.model(), chain.record(inputs, read))
    assert np.isnan(seen.residual_degC[1, 50:80]).all()
    assert np.isnan(seen.residual_degC).sum() == 30
    np.testing.assert_array_equal(seen.nodes_degC[1, :50], read[1, :50])
    np.testing.assert_array_equal(seen.nodes_degC[1, 50:80], seen.truth_degC[1, 50:80])


def test_no_reading_at_all(chain) -> None:
    inputs = chain.inputs(100)
    seen = view(chain.model(), chain.record(inputs, np.full((3, 100), np.nan)))
    assert np.isfinite(seen.nodes_degC).all()


def test_unseen_nodes_follow_the_measured_not_the_simulated(chain, blind) -> None:
    """A blind node is what its measured neighbours make it, even where those have heat that the circuit lacks."""
    inputs = chain.inputs(400)

    def unknown(t: float, state: np.ndarray, air: float) -> np.ndarray:
        return np.array([0.08, 0.0, 0.01]) * (1000 < t < 3000)

    nodes = chain.integrated(inputs, START, unknown)
    simulated = chain.integrated(inputs, START)
    found = with_measured(blind.plant(), blind.record(inputs, nodes[[0, 2]]), simulated, frozenset((0, 1)))
    np.testing.assert_array_equal(found[[0, 2]], nodes[[0, 2]])
    assert np.abs(simulated[1] - nodes[1]).max() > 3.0
    np.testing.assert_allclose(found[1], nodes[1], atol=0.05)


def test_a_doubtful_sensor_is_not_believed(chain) -> None:
    inputs = chain.inputs(200)
    nodes = chain.integrated(inputs, START)
    wrong = nodes + np.array([0.0, 9.0, 0.0])[:, None]
    found = with_measured(chain.plant(), chain.record(inputs, wrong), nodes, frozenset((0, 2)))
    np.testing.assert_array_equal(found[[0, 2]], wrong[[0, 2]])
    np.testing.assert_allclose(found[1], nodes[1], atol=0.01)
    none = with_measured(chain.plant(), chain.record(inputs, wrong), nodes, frozenset())
    np.testing.assert_array_equal(none, nodes)


def test_what_leads_where(chain) -> None:
    np.testing.assert_allclose(conductances_to_ambient(chain.plant()), [0.0, 1 / 30, 1 / 15])
    assert joined(chain.plant()) == {frozenset(("chip", "board")), frozenset(("board", "shell"))}


def test_signals_are_no_temperatures_and_absent_ones_were_off(chain) -> None:
    inputs = chain.inputs(50)
    record = chain.record(inputs, np.full((3, 50), 20.0), camera_on=np.ones(50), pocket_degC=np.ones(50))
    seen = view(chain.model(), record)
    assert set(seen.signals) == {"heater_W", "camera_on"}
    np.testing.assert_array_equal(seen.signal("torch_on"), np.zeros(50))
    np.testing.assert_array_equal(seen.ambient_degC, inputs[0])


def test_without_an_ambient_it_is_zero() -> None:
    text = """
format: ambient-circuit
version: 1
name: pair
about: Two beside a measured one
form: temperature
nodes:
  one: {capacitance: C_one, sensor: one}
  hot: {sensor: hot}
edges:
  - {between: [one, hot], resistance: R}
outputs: sensors
parameters:
  C_one: {unit: J/K, initial: 12}
  R: {unit: K/W, initial: 4}
"""
    plant = Plant.of(forward(parse_circuit(text, "pair.yaml")), {"C_one": 12.0, "R": 4.0, "whole": 1.0}, 10.0)
    record = Record(10.0, 10.0 * np.arange(40), np.full((1, 40), 30.0), np.full((1, 40), 30.0), {})
    seen = view(Model(plant), record)
    np.testing.assert_array_equal(seen.ambient_degC, np.zeros(40))
    np.testing.assert_allclose(seen.residual_degC, 0.0, atol=1e-9)
