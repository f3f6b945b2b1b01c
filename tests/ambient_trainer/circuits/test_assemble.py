"""The assembled matrices are the thesis's, corrected by its errata; their derivatives are those of the matrices."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ambient_trainer.circuits.assemble import assemble
from ambient_trainer.circuits.circuit import AMBIENT, Circuit
from ambient_trainer.circuits.schema import load_circuit

MATRICES = ("A", "B", "C", "D", "offset")


def _anywhere(circuit):
    """Values of a circuit's parameters that have nothing in common."""
    random = np.random.default_rng(3)
    return {each.name: random.uniform(0.2, 40.0) for each in circuit.parameters}


THESIS = {
    "model1_ss": "soc",
    "model1_ss_single_input": "soc",
    "model2_ss": "display",
    "model2_ss_single_input": "display",
    "model2_ss_free_cd": "display",
}


@pytest.mark.parametrize(("name", "source"), THESIS.items())
def test_the_state_space_models_of_the_thesis(name, source):
    """Equations 4.8 to 4.11 (4.20 to 4.22), 4.14 to 4.17 (4.25 to 4.28), with errata 1 to 4 and 10.

    States are flash, battery and usb; the source is the last input.
    """
    circuit = load_circuit(name)
    p = _anywhere(circuit)
    C = np.array([[p["C_flash"]], [p["C_battery"]], [p["C_usb"]]])
    G = np.array([1 / p[f"R_{each}_ambient"] for each in ("flash", "battery", "usb")])
    Gsf, Gsb, Gbu = (1 / p[f"R_{each}"] for each in (f"{source}_flash", f"{source}_battery", "battery_usb"))
    w, shares, inputs = [p[f"w{k}"] for k in range(1, 8) if f"w{k}" in p], [G / G.sum()], ("flash", "battery", "usb")
    if name.endswith("single_input"):
        A, B = [[-Gsf, 0, 0], [0, -Gsb - Gbu, Gbu], [0, Gbu, -Gbu]], [[Gsf], [Gsb], [0]]
        wanted, inputs = (shares, [[0]]), ()
    else:
        A, B = -np.diag(G), [[-Gsf, 0, 0, Gsf], [0, -Gbu - Gsb, Gbu, Gsb], [0, Gbu, -Gbu, 0]]
        wanted = ([w[:3]], [w[3:]]) if len(w) == 7 else (np.negative(shares), [[*w, 0]])
    assert circuit.inputs == tuple(f"{each}_degC" for each in (*inputs, source))
    found = assemble(circuit, p)
    for each, matrix in zip(("A", "B", "C", "D"), (A / C, B / C, *wanted)):
        np.testing.assert_allclose(getattr(found.value, each), matrix, rtol=1e-14, atol=1e-16, err_msg=each)
    np.testing.assert_array_equal(found.value.offset, [0])
    np.testing.assert_array_equal(found.capacitance, C[:, 0])


def test_kirchhoff_of_the_thesis():
    """Equation 4.4: sum (T_i - T)/R_i + q_e = 0."""
    circuit = load_circuit("model1_kirchhoff")
    p = _anywhere(circuit)
    assert circuit.inputs == ("flash_degC", "battery_degC", "usb_degC")
    found = assemble(circuit, p).value
    G = np.array([1 / p[f"R_{name}_ambient"] for name in ("flash", "battery", "usb")])
    np.testing.assert_allclose(found.D, [G / G.sum()], rtol=1e-14)
    np.testing.assert_allclose(found.offset, [p["q_e"] / G.sum()], rtol=1e-14)
    assert (found.A.shape, found.C.shape) == ((0, 0), (1, 0))


@given(st.from_type(Circuit))
@settings(max_examples=40)
def test_derivatives(circuit):
    """The analytic ones against central differences extrapolated once (error of order h^4)."""
    values = _anywhere(circuit)
    found = assemble(circuit, values).derivative
    for index, parameter in enumerate(circuit.parameters):

        def along(step, name=parameter.name):
            moved = [assemble(circuit, {**values, name: values[name] + sign * step}).value for sign in (1, -1)]
            return {each: (getattr(moved[0], each) - getattr(moved[1], each)) / (2 * step) for each in MATRICES}

        h = 1e-3 * max(abs(values[parameter.name]), 1e-3)
        coarse, fine = along(2 * h), along(h)
        for each in MATRICES:
            wanted = (4 * fine[each] - coarse[each]) / 3
            size = np.abs(getattr(assemble(circuit, values).value, each)).max(initial=0)
            tolerance = 1e-8 * np.abs(wanted).max(initial=0) + 1e-14 * size / h  # the rounding of a difference
            np.testing.assert_allclose(
                getattr(found, each)[index], wanted, rtol=1e-8, atol=tolerance, err_msg=f"{each} by {parameter.name}"
            )


@given(st.from_type(Circuit))
@settings(max_examples=40)
def test_the_balance_of_every_node(circuit):
    """C_i dT_i/dt = sum_j (T_j - T_i)/R_ij + sum_s share_s signal_s, summed edge by edge at random temperatures."""
    values = _anywhere(circuit)
    found = assemble(circuit, values)
    random = np.random.default_rng(0)
    u = dict(zip(circuit.inputs, random.normal(size=len(circuit.inputs))))
    x = random.normal(size=len(circuit.states))
    state = {node.name: value for node, value in zip(circuit.states, x)}
    read = {node.name: u.get(f"{node.sensor}_degC") for node in circuit.nodes}
    for row, node in enumerate(circuit.states):
        heat = sum(values[each.share] * u[each.signal] for each in circuit.sources if each.into == node.name)
        for edge in circuit.edges:
            if node.name not in edge.between:
                continue
            other = edge.other(node.name)
            if circuit.form == "temperature":
                there = state.get(other, read.get(other))
                difference = 0.0 if there is None else there - state[node.name]
            elif other == AMBIENT:
                difference = -state[node.name]
            else:
                difference = read[other] - read[node.name]
            heat += difference / values[edge.resistance]
        rate = found.value.A[row] @ x + found.value.B[row] @ np.array(list(u.values()))
        np.testing.assert_allclose(rate * found.capacitance[row], heat, rtol=1e-9, atol=1e-9)
