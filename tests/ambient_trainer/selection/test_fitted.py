"""What carries nothing is not drawn, and the estimate stays the same."""

from __future__ import annotations

import numpy as np
import pytest

from ambient_trainer.circuits.assemble import assemble
from ambient_trainer.circuits.schema import parse_circuit
from ambient_trainer.circuits.write import write_circuit
from ambient_trainer.lti.response import response_degC
from ambient_trainer.selection.fitted import fitted_circuit
from ambient_trainer.selection.wiring import Wiring, circuit_of

TAU_S = (90.0, 20.0)
HIDDEN = Wiring(
    "temperature",
    ("left", "right"),
    ("hidden1", "hidden2"),
    (("hidden1", "hidden2"), ("hidden1", "left"), ("hidden1", "right"), ("hidden2", "right")),
)
OWN = Wiring("rise", ("left", "mixed", "right"), ("left",), (("left", "mixed"), ("left", "right")))


def values_of(circuit, **changed):
    random = np.random.default_rng(0)
    found = {each.name: each.initial for each in circuit.parameters}
    found.update({name: random.normal() for name in found if name[:2] in ("c_", "d_")})
    return {**found, **changed}


@pytest.mark.parametrize(
    ("wiring", "name", "edge"),
    [
        (HIDDEN, "R_hidden1_left", ("hidden1", "left")),
        (HIDDEN, "R_hidden1_hidden2", ("hidden1", "hidden2")),
        (OWN, "R_left_right", ("left", "right")),
    ],
)
def test_an_edge_that_carries_nothing_is_gone_and_nothing_else_changes(small, wiring, name, edge):
    circuit = circuit_of(wiring, TAU_S, "found", "found")
    values = values_of(circuit, **{name: 1e7})
    less, drawn = fitted_circuit(circuit, wiring, values)
    assert set(drawn.edges) == set(wiring.edges) - {edge}
    assert name not in {each.name for each in less.parameters}
    again = parse_circuit(write_circuit(less), "found.yaml")
    u = small.segments[0].inputs[[small.names.index(each.removesuffix("_degC")) for each in circuit.inputs]]
    whole = response_degC(assemble(circuit, values).value, "first-order", u, 2.0)
    given = {each.name: each.initial for each in again.parameters}
    np.testing.assert_allclose(response_degC(assemble(again, given).value, "first-order", u, 2.0), whole, atol=1e-2)


def test_a_state_that_is_on_its_own_again_has_its_capacitance_set():
    circuit = circuit_of(HIDDEN, TAU_S, "found", "found")
    free = {each.name: each.free for each in circuit.parameters}
    assert free["C_hidden2"]
    less, _ = fitted_circuit(circuit, HIDDEN, values_of(circuit, R_hidden1_hidden2=1e7))
    assert not {each.name: each.free for each in less.parameters}["C_hidden2"]


def test_what_carries_something_stays():
    circuit = circuit_of(HIDDEN, TAU_S, "found", "found")
    values = values_of(circuit)
    less, drawn = fitted_circuit(circuit, HIDDEN, values)
    assert drawn == HIDDEN
    assert less.edges == circuit.edges
    assert {each.name: each.initial for each in less.parameters} == pytest.approx(values | {
        name: np.clip(values[name], -10, 10) for name in values if name[:2] in ("c_", "d_")
    })  # fmt: skip
