"""A topology becomes a circuit that a file can hold, that can be fitted, and whose every parameter is identifiable."""

import numpy as np
import pytest

from ambient_trainer.circuits.assemble import assemble
from ambient_trainer.circuits.schema import parse_circuit
from ambient_trainer.circuits.write import write_circuit
from ambient_trainer.estimation.structure import linearise
from ambient_trainer.lti.response import response_degC
from ambient_trainer.selection import topology as topology_module
from ambient_trainer.selection.search import circuit_structure
from ambient_trainer.selection.topology import Topology, best_topology, can_be_named, circuit_of, neighbours

from ..conftest import truth_of

SENSORS = ("left", "mixed", "right")
TAU_S = (90.0, 20.0, 6.0)
HIDDEN = Topology(
    "temperature",
    ("left", "right"),
    ("hidden1", "hidden2"),
    (("hidden1", "hidden2"), ("hidden1", "left"), ("hidden1", "right"), ("hidden2", "right")),
)
OWN = Topology("rise", ("left", "mixed", "right"), ("left",), (("left", "mixed"), ("left", "right")))


def walked(sensors, most_states, seed, steps=40):
    """Topologies on a random walk from each start."""
    random = np.random.default_rng(seed)
    passed = []
    for here in topology_module.initial_topologies(sensors, most_states):
        for _ in range(steps):
            around = neighbours(here, most_states)
            here = around[random.integers(len(around))]
            passed.append(here)
    return list(dict.fromkeys(passed))


def test_every_step_leads_to_a_circuit_that_a_file_can_hold():
    for topology in walked(SENSORS, 3, 0):
        assert topology.complete
        assert 1 <= len(topology.states) <= 3
        circuit = circuit_of(topology, TAU_S, "searched", "by a search")
        assert parse_circuit(write_circuit(circuit), "searched").inputs == circuit.inputs
        assert {each.name for each in circuit.states} == set(topology.states)
        exchange = [tuple(sorted(each.between)) for each in circuit.edges if "ambient" not in each.between]
        assert sorted(exchange) == sorted(topology.edges)


def test_steps_can_be_taken_back_and_none_stands_twice():
    for topology in walked(SENSORS, 2, 7, steps=12):
        steps = neighbours(topology, 2)
        assert len(set(steps)) == len(steps)
        for step in steps:
            if len(step.states) == len(topology.states):
                assert topology in neighbours(step, 2)


def test_no_scale_is_left_open(small):
    """At a random point, the Jacobian in all unknowns, poles' and weights', has full rank."""
    random = np.random.default_rng(5)
    for topology in walked(SENSORS, 2, 3, steps=20):
        if any(set(edge) <= set(topology.states) for edge in topology.edges) and topology.form == "temperature":
            continue  # hidden nodes that are joined can also be mixed with one another
        structure = circuit_structure(small.segments, small.names, TAU_S, topology)
        theta = structure.search.initial + random.normal(scale=0.3, size=len(structure.search.names))
        problem = linearise(structure, theta, random.normal(size=len(structure.linear.names)))
        J = np.column_stack([problem.free, problem.slopes])
        singular = np.linalg.svd(J / np.linalg.norm(J, axis=0), compute_uv=False)
        assert singular[-1] > 1e-7 * singular[0], topology


def test_names_that_run_together_stay_two_parameters():
    topology = Topology("rise", ("a", "a_b", "b_c", "c"), ("a", "a_b"), (("a", "b_c"), ("a", "c"), ("a_b", "c")))
    circuit = circuit_of(topology, TAU_S, "searched", "by a search")
    assert len({each.resistance for each in circuit.edges}) == len(circuit.edges)


@pytest.mark.parametrize(
    ("sensor", "can"), [("usb", True), ("cam-tele", False), ("ambient", False), ("hidden1", False)]
)
def test_what_a_circuit_file_can_name(sensor, can):
    assert can_be_named(sensor) == can


def test_the_steps_find_the_topology_that_was_hidden_and_leave_out_an_edge_that_gains_nothing():
    """The error is the number of edges that differ from a topology's: every step towards it gains."""
    hidden = Topology("rise", SENSORS, ("left", "right"), (("left", "mixed"), ("left", "right")))

    def score(topologies):
        return [
            (1.0 if each.form == "rise" else 3.0)
            + len(set(each.edges) ^ set(hidden.edges))
            + len(set(each.states) ^ set(hidden.states))
            for each in topologies
        ]

    assert best_topology(SENSORS, 3, score) == hidden

    def score(topologies):
        return [1.0 - 0.0001 * len(each.edges) + (each.form == "rise") for each in topologies]

    assert len(best_topology(("left", "right"), 2, score).edges) == 1


@pytest.mark.parametrize(
    ("topology", "name", "edge"),
    [
        (HIDDEN, "R_hidden1_left", ("hidden1", "left")),
        (HIDDEN, "R_hidden1_hidden2", ("hidden1", "hidden2")),
        (OWN, "R_left_right", ("left", "right")),
    ],
)
def test_an_edge_that_conducts_nothing_is_gone_and_nothing_else_changes(small, topology, name, edge):
    circuit = circuit_of(topology, TAU_S, "searched", "by a search")
    random, values = np.random.default_rng(0), truth_of(circuit)
    values.update({each: random.normal() for each in values if each[:2] in ("c_", "d_")})
    values[name] = 1e7
    less, drawn = topology_module.pruned(circuit, topology, values)
    assert set(drawn.edges) == set(topology.edges) - {edge}
    assert name not in {each.name for each in less.parameters}
    # a state that is alone again has its capacitance set
    free = {each.name: each.free for each in less.parameters}
    assert free.get("C_hidden2", False) == (topology is HIDDEN and edge != ("hidden1", "hidden2"))
    again = parse_circuit(write_circuit(less), "searched.yaml")
    u = small.segments[0].inputs[[small.names.index(each.removesuffix("_degC")) for each in circuit.inputs]]
    systems = [assemble(*each).value for each in ((again, truth_of(again)), (circuit, values))]
    np.testing.assert_allclose(*(response_degC(each, "first-order", u, 2.0) for each in systems), atol=1e-2)
