"""A circuit of either form read forward has the physics' A and B; one that cannot be is refused with the way out."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from ambient_trainer.circuits.assemble import assemble
from ambient_trainer.circuits.schema import load_circuit
from ambient_trainer.diagnosis.forward import forward
from refusals import refused

RISE = Path(__file__).parents[2] / "data" / "circuits" / "two_beside_one.yaml"


def test_rise_circuit_turned_round():
    circuit = forward(load_circuit(str(RISE)))
    assert circuit.form == "temperature"
    assert [node.name for node in circuit.states] == ["board", "shell"]
    assert circuit.inputs == ("soc_degC", "ambient_degC", "charger_W")
    assert [(output.name, output.offset) for output in circuit.outputs] == [("board", None), ("skin", None)]
    # the rise form's weights and offset have nothing left to weigh
    names = {each.name for each in circuit.parameters}
    assert names == {"C_board", "C_shell", "R_inner", "R_outer", "R_far", "k", "whole"}
    value = assemble(circuit, {each.name: each.initial for each in circuit.parameters}).value
    np.testing.assert_allclose(value.A, [[-1 / 24 - 1 / 600, 1 / 48], [1 / 120, -1 / 120 - 1 / 600]], rtol=1e-14)
    np.testing.assert_allclose(value.B, [[1 / 48, 1 / 600, 0.5 / 12], [0, 1 / 600, 0]], rtol=1e-14)
    np.testing.assert_array_equal(value.C, np.eye(2))
    assert not value.D.any()
    assert not value.offset.any()


def test_forward_circuit_stays_and_an_ambient_with_a_capacitance_is_prescribed():
    once = forward(load_circuit(str(RISE)))
    assert forward(once) == once
    heavy = tuple(replace(node, capacitance="C_shell") if node.name == "ambient" else node for node in once.nodes)
    assert forward(replace(once, nodes=heavy)) == once


def test_no_capacity_is_refused():
    """Sensors on nodes without a capacitance only drive; a state that nothing reads shows nothing."""
    circuit = load_circuit(str(RISE))
    unread = tuple(replace(node, sensor=None) if node.capacitance else node for node in circuit.nodes)
    assert "no sensor reads a node with a capacitance" in str(refused(forward, replace(circuit, nodes=unread)))


def test_no_way_out_is_refused():
    circuit = load_circuit(str(RISE))
    closed = tuple(edge for edge in circuit.edges if not {"ambient", "chip"} & set(edge.between))
    assert "no temperature is prescribed" in str(refused(forward, replace(circuit, nodes=circuit.states, edges=closed)))
