"""The assembled matrices are the thesis's, corrected by its errata; their derivatives are those of the matrices."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ambient_trainer.circuits.assemble import assemble
from ambient_trainer.circuits.circuit import AMBIENT, Circuit, Edge, Node, Output, Parameter, Source
from ambient_trainer.circuits.schema import circuit_names, load_circuit

MATRICES = ("A", "B", "C", "D", "offset")

# the published estimates; erratum 6 corrects w1 of table 4.4 from 0.42 to 0.042
TABLE_4_1 = {"R_battery_ambient": 2.28e5, "R_usb_ambient": 0.01, "R_flash_ambient": 2.32e5, "q_e": 1.0}
TABLE_4_2 = {
    "C_flash": 4.45, "C_battery": 0.47, "C_usb": 0.20,
    "R_flash_ambient": 4.05, "R_battery_ambient": 0.67, "R_usb_ambient": 0.01,
    "R_soc_flash": 0.44, "R_soc_battery": 0.53, "R_battery_usb": 1.60,
    "w1": 0.0, "w2": 0.0, "w3": 0.96,
}  # fmt: skip
TABLE_4_3 = {
    "C_flash": 1.0, "C_battery": 199.9, "C_usb": 5172.0,
    "R_flash_ambient": 223.9, "R_battery_ambient": 156.6, "R_usb_ambient": 272.3,
    "R_soc_flash": 1.1e4, "R_soc_battery": 2.59, "R_battery_usb": 5176.0,
}  # fmt: skip
TABLE_4_4 = {
    "C_flash": 14.14, "C_battery": 37.72, "C_usb": 0.08,
    "R_flash_ambient": 11.57, "R_battery_ambient": 36.74, "R_usb_ambient": 0.18,
    "R_display_flash": 9.59, "R_display_battery": 3.82, "R_battery_usb": 11.71,
    "w1": 0.042, "w2": 0.0, "w3": 0.94,
}  # fmt: skip
TABLE_4_5 = {
    "C_flash": 1.0, "C_battery": 0.13, "C_usb": 3.26,
    "R_flash_ambient": 2.21, "R_battery_ambient": 0.10, "R_usb_ambient": 1.05,
    "R_display_flash": 0.19, "R_display_battery": 2.33, "R_battery_usb": 2.26,
}  # fmt: skip
TABLE_4_6 = {
    "C_flash": 4.16, "C_battery": 1.98, "C_usb": 1.82,
    "R_flash_ambient": 3.96, "R_battery_ambient": 10.34, "R_usb_ambient": 11.05,
    "R_display_flash": 1.66, "R_display_battery": 30.09, "R_battery_usb": 0.76,
    "w1": 0.29, "w2": 11.43, "w3": 10.98, "w4": 0.27, "w5": -1.68, "w6": -4.34, "w7": 6.72,
}  # fmt: skip
PUBLISHED = {
    "model1_kirchhoff": TABLE_4_1,
    "model1_ss": TABLE_4_2,
    "model1_ss_single_input": TABLE_4_3,
    "model2_ss": TABLE_4_4,
    "model2_ss_single_input": TABLE_4_5,
    "model2_ss_free_cd": TABLE_4_6,
}


def _rise_matrices(p, source):
    """Equations 4.8, 4.9 (4.20, 4.21) with errata 1 and 4: states flash, battery, usb; the source is the last input."""
    Cf, Cb, Cu = p["C_flash"], p["C_battery"], p["C_usb"]
    Rfa, Rba, Rua = p["R_flash_ambient"], p["R_battery_ambient"], p["R_usb_ambient"]
    Rsf, Rsb, Rbu = p[f"R_{source}_flash"], p[f"R_{source}_battery"], p["R_battery_usb"]
    A = np.diag([-1 / (Cf * Rfa), -1 / (Cb * Rba), -1 / (Cu * Rua)])
    B = np.array(
        [
            [-1 / (Rsf * Cf), 0, 0, 1 / (Rsf * Cf)],
            [0, -(1 / Rbu + 1 / Rsb) / Cb, 1 / (Rbu * Cb), 1 / (Rsb * Cb)],
            [0, 1 / (Rbu * Cu), -1 / (Rbu * Cu), 0],
        ]
    )
    return A, B


def _shares(p):
    G = np.array([1 / p["R_flash_ambient"], 1 / p["R_battery_ambient"], 1 / p["R_usb_ambient"]])
    return (G / G.sum())[None]


@pytest.mark.parametrize(
    ("name", "source", "values"), [("model1_ss", "soc", TABLE_4_2), ("model2_ss", "display", TABLE_4_4)]
)
def test_the_state_space_models_of_the_thesis(name, source, values):
    circuit = load_circuit(name)
    assert circuit.inputs == ("flash_degC", "battery_degC", "usb_degC", f"{source}_degC")
    found = assemble(circuit, values)
    A, B = _rise_matrices(values, source)
    np.testing.assert_allclose(found.value.A, A, rtol=1e-14)
    np.testing.assert_allclose(found.value.B, B, rtol=1e-14, atol=1e-16)
    np.testing.assert_allclose(found.value.C, -_shares(values), rtol=1e-14)  # equations 4.11 and 4.22
    np.testing.assert_array_equal(found.value.D, [[values["w1"], values["w2"], values["w3"], 0]])
    np.testing.assert_array_equal(found.value.offset, [0])
    np.testing.assert_array_equal(found.capacitance, [values["C_flash"], values["C_battery"], values["C_usb"]])


@pytest.mark.parametrize(
    ("name", "source", "p"),
    [("model1_ss_single_input", "soc", TABLE_4_3), ("model2_ss_single_input", "display", TABLE_4_5)],
)
def test_the_single_input_models_of_the_thesis(name, source, p):
    """Equations 4.14 to 4.17 (4.25 to 4.28) with errata 1, 2, 3 and 10."""
    Cf, Cb, Cu = p["C_flash"], p["C_battery"], p["C_usb"]
    Rsf, Rsb, Rbu = p[f"R_{source}_flash"], p[f"R_{source}_battery"], p["R_battery_usb"]
    circuit = load_circuit(name)
    assert circuit.inputs == (f"{source}_degC",)
    found = assemble(circuit, p).value
    A = [[-1 / (Rsf * Cf), 0, 0], [0, -(1 / Rsb + 1 / Rbu) / Cb, 1 / (Rbu * Cb)], [0, 1 / (Rbu * Cu), -1 / (Rbu * Cu)]]
    np.testing.assert_allclose(found.A, A, rtol=1e-14, atol=1e-18)
    np.testing.assert_allclose(found.B, [[1 / (Rsf * Cf)], [1 / (Rsb * Cb)], [0]], rtol=1e-14)
    np.testing.assert_allclose(found.C, _shares(p), rtol=1e-14)
    np.testing.assert_array_equal(found.D, [[0]])
    if source == "display":  # the real poles of erratum 2
        np.testing.assert_allclose(np.sort(np.linalg.eigvals(found.A)), [-6.77, -5.26, -0.066], rtol=0.01)


def test_model_2_with_free_c_and_d():
    found = assemble(load_circuit("model2_ss_free_cd"), TABLE_4_6).value
    A, B = _rise_matrices(TABLE_4_6, "display")
    np.testing.assert_allclose(found.A, A, rtol=1e-14)
    np.testing.assert_allclose(found.B, B, rtol=1e-14, atol=1e-16)
    np.testing.assert_array_equal(found.C, [[0.29, 11.43, 10.98]])
    np.testing.assert_array_equal(found.D, [[0.27, -1.68, -4.34, 6.72]])
    gains = (found.D - found.C @ np.linalg.solve(found.A, found.B))[0]  # erratum 1
    np.testing.assert_allclose(gains, [-0.42, -1.47, -8.48, 11.34], atol=0.005)
    assert gains.sum() == pytest.approx(0.970, abs=0.0005)


@pytest.mark.parametrize("p", [TABLE_4_1, {**TABLE_4_1, "R_usb_ambient": 3e5, "q_e": 7e-5}])
def test_kirchhoff_of_the_thesis(p):
    """Equation 4.4: sum (T_i - T)/R_i + q_e = 0."""
    circuit = load_circuit("model1_kirchhoff")
    assert circuit.inputs == ("flash_degC", "battery_degC", "usb_degC")
    found = assemble(circuit, p).value
    G = np.array([1 / p[f"R_{name}_ambient"] for name in ("flash", "battery", "usb")])
    np.testing.assert_allclose(found.D, [G / G.sum()], rtol=1e-14)
    np.testing.assert_allclose(found.offset, [p["q_e"] / G.sum()], rtol=1e-14)
    assert (found.A.shape, found.C.shape) == ((0, 0), (1, 0))


def test_the_static_models_are_lines_and_a_plane():
    line = assemble(load_circuit("linear_usb"), {"k": 0.96, "m": -0.88}).value
    assert (line.A.shape, line.C.shape) == ((0, 0), (1, 0))
    np.testing.assert_array_equal(line.D, [[0.96]])
    np.testing.assert_array_equal(line.offset, [-0.88])
    circuit = load_circuit("linear_combined")
    plane = assemble(circuit, {"c0": -1.36, "c1": 1.52, "c2": 0.80, "m": -0.38}).value
    assert circuit.inputs == ("battery_degC", "usb_degC", "flash_degC")  # erratum 5
    np.testing.assert_array_equal(plane.D, [[-1.36, 1.52, 0.80]])


def _assert_slopes(circuit, values):
    """The analytic derivatives against central differences extrapolated once (error of order h^4)."""
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


@pytest.mark.parametrize("name", circuit_names())
def test_derivatives_of_the_shipped_circuits(name):
    circuit = load_circuit(name)
    _assert_slopes(circuit, {each.name: each.initial for each in circuit.parameters})
    if name in PUBLISHED:
        _assert_slopes(circuit, PUBLISHED[name])


_MAGNITUDE = st.floats(0.05, 500)


@st.composite
def circuits(draw, form):
    """A random circuit in which several edges, nodes and outputs may share a parameter."""
    n, prescribed = draw(st.integers(1, 4)), draw(st.integers(0, 2))
    ambient_read = form == "temperature" and (prescribed == 0 or draw(st.booleans()))
    capacities = [f"C{draw(st.integers(0, n - 1))}" for _ in range(n)]
    nodes = [Node(f"n{k}", capacities[k], f"n{k}") for k in range(n)]
    nodes += [Node(f"p{k}", None, f"p{k}") for k in range(prescribed)]
    if ambient_read:
        nodes.append(Node(AMBIENT, None, AMBIENT))
    names = [node.name for node in nodes if node.name != AMBIENT] + [AMBIENT]
    pairs = st.tuples(st.sampled_from(names), st.sampled_from(names)).filter(lambda pair: pair[0] != pair[1])
    edges = [Edge((f"n{k}", AMBIENT), f"R{draw(st.integers(0, 3))}") for k in range(n)]
    edges += [Edge(pair, f"R{draw(st.integers(0, 3))}") for pair in draw(st.lists(pairs, max_size=6))]
    sources = [
        Source(f"n{draw(st.integers(0, n - 1))}", f"s{k}_W", f"share{draw(st.integers(0, 1))}")
        for k in range(draw(st.integers(0, 3)))
    ]
    circuit = Circuit("random", "random", form, "zero-order", tuple(nodes), tuple(edges), tuple(sources), (), ())
    outputs = [Output("parallel", None, {}, "offset")]
    weights = {f"n{k}": f"w{k % 2}" for k in range(n)}
    outputs.append(Output("weighed", weights, dict.fromkeys(circuit.inputs, "w0"), None))
    if circuit.to_ambient(circuit.measured):
        outputs += [Output("balanced", {}, {}, offset, "heat") for offset in ("offset", None)]
    names = [*(node.capacitance for node in nodes if node.capacitance), *(edge.resistance for edge in edges)]
    names += [*(source.share for source in sources), "w0", "w1", "offset", "heat"]
    parameters = tuple(Parameter(name, "1", 1, -1e9, 1e9, True) for name in dict.fromkeys(names))
    values = {each.name: draw(_MAGNITUDE) for each in parameters}
    return replace(circuit, outputs=tuple(outputs), parameters=parameters), values


@given(circuits("rise") | circuits("temperature"))
@settings(max_examples=25)
def test_derivatives_of_random_circuits(drawn):
    _assert_slopes(*drawn)


@given(circuits("rise") | circuits("temperature"))
@settings(max_examples=40)
def test_the_balance_of_every_node(drawn):
    """C_i dT_i/dt = sum_j (T_j - T_i)/R_ij + sum_s share_s signal_s, summed edge by edge at random temperatures."""
    circuit, values = drawn
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
