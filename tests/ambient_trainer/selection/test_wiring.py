"""A wiring becomes a circuit that a file can hold, that can be fitted, and whose every parameter the data can tell."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from ambient_trainer.circuits.schema import load_circuit, parse_circuit
from ambient_trainer.circuits.write import save_circuit, write_circuit
from ambient_trainer.estimation.circuit_structure import CircuitStructure
from ambient_trainer.estimation.separable import project
from ambient_trainer.estimation.structure import linearise
from ambient_trainer.estimators.fit import Effort, fit_circuit
from ambient_trainer.selection.stepwise import best_wiring
from ambient_trainer.selection.tasks import WiringFits
from ambient_trainer.selection.wiring import Wiring, can_be_named, circuit_of, neighbours, starting_wirings

SENSORS = ("left", "mixed", "right")
TAU_S = (90.0, 20.0, 6.0)


def walked(sensors, most_states, seed, steps=40):
    """Wirings on a random walk from each start."""
    random = np.random.default_rng(seed)
    found = []
    for start in starting_wirings(sensors, most_states):
        here = start
        for _ in range(steps):
            around = neighbours(here, most_states)
            here = around[random.integers(len(around))]
            found.append(here)
    return list(dict.fromkeys(found))


@pytest.mark.parametrize("seed", range(4))
def test_every_step_leads_to_a_circuit_that_a_file_can_hold(seed):
    for wiring in walked(SENSORS, 3, seed):
        assert wiring.complete
        assert 1 <= len(wiring.states) <= 3
        assert Wiring.of_text(wiring.text) == wiring
        circuit = circuit_of(wiring, TAU_S, "found", "found by a search")
        assert parse_circuit(write_circuit(circuit), "found").inputs == circuit.inputs
        assert {each.name for each in circuit.states} == set(wiring.states)
        exchange = [tuple(sorted(each.between)) for each in circuit.edges if "ambient" not in each.between]
        assert sorted(exchange) == sorted(wiring.edges)


def test_steps_can_be_taken_back():
    for wiring in walked(SENSORS, 2, 7, steps=12):
        for step in neighbours(wiring, 2):
            if len(step.states) == len(wiring.states):
                assert wiring in neighbours(step, 2)


def test_hidden_nodes_have_no_order():
    one = Wiring("temperature", ("a", "b"), ("hidden1", "hidden2"), (("a", "hidden1"), ("b", "hidden2")))
    grown = [each for each in neighbours(one, 2) if ("hidden1", "hidden2") in each.edges]
    assert len(grown) == 1
    assert len(set(neighbours(one, 2))) == len(neighbours(one, 2))


def test_no_scale_is_left_open(small):
    """At a random point, the Jacobian in all unknowns, poles' and weights', has full rank."""
    random = np.random.default_rng(5)
    task = WiringFits(tuple(small.segments), small.blocks, tuple(small.names), TAU_S)
    for wiring in walked(SENSORS, 2, 3, steps=25):
        if any(set(edge) <= set(wiring.states) for edge in wiring.edges) and wiring.form == "temperature":
            continue  # hidden nodes that are joined can also be mixed with one another
        structure = task.structure(wiring)
        theta = structure.search.initial + random.normal(scale=0.3, size=len(structure.search.names))
        problem = linearise(structure, theta)
        beta = random.normal(size=len(structure.linear.names))
        J = np.column_stack([problem.free, (problem.free_slope @ beta + problem.fixed_slope).T])
        singular = np.linalg.svd(J / np.linalg.norm(J, axis=0), compute_uv=False)
        assert singular[-1] > 1e-7 * singular[0], wiring
        assert project(problem, structure.linear).residual.shape == problem.target.shape


def test_a_written_circuit_is_fitted_as_any_other(small, tmp_path):
    wiring = starting_wirings(("left", "right"), 2)[0]
    path = str(tmp_path / "found.yaml")
    save_circuit(path, circuit_of(wiring, TAU_S, "found", "found by a search"))
    fit = fit_circuit(load_circuit(path), [small.trace], Effort(starts=1))
    assert fit.outputs == ("ambient",)
    assert set(fit.inputs) == {"left_degC", "right_degC"}
    assert fit.rmse_degC < 1.0


def test_weights_of_nearly_equal_states_cannot_cancel_in_their_thousands(small):
    circuit = circuit_of(starting_wirings(SENSORS, 3)[-1], TAU_S, "found", "found")
    structure = CircuitStructure(circuit, small.segments)
    weights = [name for name in structure.linear.names if name[:2] in ("c_", "d_")]
    assert len(weights) == 6
    assert np.abs(structure.linear.high[: len(weights)]).max() == 10.0


def test_names_that_run_together_stay_two_parameters():
    wiring = Wiring("rise", ("a", "a_b", "b_c", "c"), ("a", "a_b"), (("a", "b_c"), ("a", "c"), ("a_b", "c")))
    circuit = circuit_of(wiring, TAU_S, "found", "found")
    assert len({each.resistance for each in circuit.edges}) == len(circuit.edges)


@pytest.mark.parametrize(
    ("sensor", "can"), [("usb", True), ("cam-tele", False), ("ambient", False), ("hidden1", False)]
)
def test_what_a_circuit_file_can_name(sensor, can):
    assert can_be_named(sensor) == can


def test_the_steps_find_the_wiring_that_was_hidden():
    """The error is the number of edges that differ from a wiring's: every step towards it gains."""
    hidden = Wiring("rise", SENSORS, ("left", "right"), (("left", "mixed"), ("left", "right")))

    def score(wirings):
        return [
            (1.0 if each.form == "rise" else 3.0)
            + len(set(each.edges) ^ set(hidden.edges))
            + len(set(each.states) ^ set(hidden.states))
            for each in wirings
        ]

    assert best_wiring(SENSORS, 3, score) == hidden


def test_an_edge_that_gains_nothing_is_left_out():
    sensors = ("left", "right")
    asked = []

    def score(wirings):
        asked.extend(wirings)
        return [1.0 - 0.0001 * len(each.edges) + (each.form == "rise") for each in wirings]

    found = best_wiring(sensors, 2, score)
    assert len(found.edges) == 1
    assert len(set(asked)) > len(list(itertools.combinations(sensors, 2)))
