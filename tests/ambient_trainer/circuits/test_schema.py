"""A circuit file is taken whole or refused with every fault and its place; what is written is read back the same."""

import contextlib
import re
from pathlib import Path

import pytest
import yaml
from hypothesis import example, given, settings
from hypothesis import strategies as st

from ambient_model.faults import Refused
from ambient_trainer.circuits.circuit import Circuit, Edge, Node, Output, Parameter
from ambient_trainer.circuits.schema import circuit_names, load_circuit, parse_circuit
from ambient_trainer.circuits.write import write_circuit
from documents import anything, damaged
from refusals import refused

DOCS = Path(__file__).parents[3] / "trainer" / "docs" / "reference"
EXAMPLE = re.search(r"```yaml\n(.*?)```", (DOCS / "circuit.md").read_text(), re.DOTALL)[1]

LINEAR = ("linear_battery", "linear_combined", "linear_flash", "linear_usb")
STATES = ("model1_kirchhoff", "model1_ss", "model1_ss_single_input", "model2_ss", "model2_ss_free_cd")
THESIS = (*LINEAR, *STATES, "model2_ss_single_input")


def test_the_example_of_the_documentation_loads():
    circuit = parse_circuit(EXAMPLE.replace("name: two_nodes", "name: two-nodes"), "example")
    assert parse_circuit(write_circuit(circuit), "again").name == "two-nodes"
    assert circuit.nodes == (Node("board", "C_board", "board"), Node("chip", None, "chip"))
    assert circuit.edges == (Edge(("chip", "board"), "R_chip_board"), Edge(("board", "ambient"), "R_board_ambient"))
    assert circuit.outputs == (Output("ambient", None, {"board_degC": "w"}, None),)
    assert circuit.inputs == ("board_degC", "chip_degC")
    assert circuit.hold == "first-order"
    assert circuit.parameters == (
        Parameter("C_board", "J/K", 10.0, 10 * 1e-6, 10e6, True),
        Parameter("R_chip_board", "K/W", 5.0, 0.1, 50.0, True),
        Parameter("R_board_ambient", "K/W", 20.0, 20 * 1e-6, 20e6, True),
        Parameter("w", "1", 1.0, float("-inf"), float("inf"), False),
    )


def test_the_shipped_circuits_load_and_an_unknown_name_is_answered_with_theirs():
    assert [load_circuit(name).name for name in circuit_names()] == list(circuit_names())
    assert set(circuit_names()) >= set(THESIS)
    assert ", ".join(circuit_names()) in str(refused(load_circuit, "model3"))


def test_a_number_is_a_parameter_that_is_not_searched():
    circuit = parse_circuit(EXAMPLE.replace("resistance: R_chip_board", "resistance: 1e1").replace(_LINE, ""), "x")
    assert circuit.edges[0].resistance == "edges[0].resistance"
    assert circuit.parameters[-1] == Parameter("edges[0].resistance", "K/W", 10.0, 10.0, 10.0, False)


_LINE = "  R_chip_board: {unit: K/W, initial: 5, min: 0.1, max: 50}\n"


def test_sensors_is_one_output_for_every_sensor_on_a_state():
    text = re.findall(r"```yaml\n(.*?)```", (DOCS / "circuit.md").read_text(), re.DOTALL)[1]
    circuit = parse_circuit(text, "x")
    assert circuit.outputs == (Output("board", {"board": "outputs.board.states.board"}, {}, None),)
    assert circuit.inputs == ("ambient_degC",)
    said = str(refused(parse_circuit, re.sub("  ambient: .*\n", "", text), "x"))
    assert "add what drives it, such as 'ambient: {sensor: ambient}'" in said


_OUTPUTS = "outputs:\n  ambient: {states: parallel, inputs: {board_degC: w}}\n"

# what replaces what in the example, and each fault's place and a word of it
BOARD, CHIP, NODE = "R_board_ambient", "R_chip_board", "chip: {sensor: chip}"
UNUSED = ("parameters.R_board_ambient", "nothing uses it")
FAULTY = [
    ("form: rise  ", "frm: rise  ", ("form", "missing"), ("frm", "name, about, form, hold, nodes, edges")),
    ("version: 1", "version: 2", ("version", "2")),
    ("K/W, initial: 20", "K/W, initial: -2", ("edges[1].resistance", "R_board_ambient starts at -2")),
    ("K/W, initial: 20", "K/W, initial: 2.0e+300", ("edges[1].resistance", "unit, K/W")),
    (f"resistance: {BOARD}", "resistance: -2", ("edges[1].resistance", "-2"), UNUSED),
    (f"resistance: {BOARD}", "resistance: R_b", ("edges[1].resistance", "'R_b'"), UNUSED),
    (f"resistance: {BOARD}", "resistance: C_board", ("edges[1].resistance", "J/K"), UNUSED),
    ("parameters:\n", "parameters:\n  R_spare: {unit: K/W, initial: 1}\n", ("parameters.R_spare", "nothing uses it")),
    ("[chip, board]", "[chop, board]", ("edges[0].between", "'chop'")),
    ("[chip, board]", "[board, board]", ("edges[0].between", "is both ends")),
    ("initial: 10", "initial: .nan", ("parameters.C_board.initial", "finite")),
    (f"resistance: {CHIP}", "resistance: .nan", ("edges[0].resistance", "finite number")),
    (f"resistance: {CHIP}", "resistance: true", ("edges[0].resistance", "neither a name nor a number")),
    ("initial: 5, min: 0.1", "initial: 5, min: 6", ("parameters.R_chip_board.initial", "5 lies outside")),
    (", sensor: board", "", ("nodes.board", "no sensor"), ("outputs.ambient.inputs", "inputs are chip_degC")),
    (NODE, "chip: {}", ("nodes.chip", "neither capacitance nor sensor"), ("nodes.chip", "no sensor")),
    (NODE, "chip: {sensor: board}", ("nodes.chip.sensor", "'board' reads another node")),
    (NODE, "chip: {sensor: ambient}", ("outputs.ambient", "'ambient_degC'")),
    (NODE, NODE + "\n  ambient: {capacitance: 3}", ("nodes.ambient", "boundary"), ("nodes.ambient", "path")),
    ("[board, ambient]", "[board, chip]", ("outputs.ambient.states", "no edge"), ("nodes.board", "path")),
    ("states: parallel", "states: series", ("outputs.ambient.states", "weight for each node")),
    ("states: parallel", "states: {chip: 1}", ("outputs.ambient.states", "'chip'")),
    ("inputs: {board_degC: w}", "inputs: {board_degC: w}, heat: 1", ("outputs.ambient.heat", "'inputs: parallel'")),
    ("{board_degC: w}", "sum", ("outputs.ambient.inputs", "weight for each column")),
    ("{board_degC: w}", "{bord_degC: w}", ("outputs.ambient.inputs", "inputs are board_degC, chip_degC")),
    (_OUTPUTS, "outputs: {}\n", ("outputs", "none"), ("parameters.w", "nothing uses it")),
    ("outputs:\n", "sources: [{into: chip, signal: cpu_power_W}]\noutputs:\n", ("sources[0].into", "'chip'")),
    ("  C_board: {", "  C_board: {unit: J/K, initial: 3}\n  C_board: {", ("line 16, column 3", "'C_board'")),
    ("name: two_nodes", "name: [two_nodes", ("line 4, column 6", "not YAML")),
    (EXAMPLE, "# nothing but a remark\n", ("", "empty")),
]


def _faults(text):
    refusal = refused(parse_circuit, text, "two.yaml")
    assert refusal.source == "two.yaml"
    return refusal.faults


@pytest.mark.parametrize("case", FAULTY)
def test_a_faulty_file_is_refused_with_every_fault(case):
    before, after, *expected = case
    assert EXAMPLE.count(before) == 1
    faults = _faults(EXAMPLE.replace(before, after))
    assert [each.place for each in faults] == [place for place, _ in expected]
    assert all(word in str(each) for each, (_, word) in zip(faults, expected))


def test_heat_that_only_goes_round_is_refused():
    """Two states joined to each other alone integrate for ever, though each has an edge."""
    text = """
format: ambient-circuit
version: 1
name: loop
form: temperature
nodes:
  {a: {capacitance: 1, sensor: a}, b: {capacitance: 1, sensor: b}, c: {capacitance: 1, sensor: c}, chip: {sensor: chip}}
edges: [{between: [a, b], resistance: 1}, {between: [c, chip], resistance: 1}, {between: [a, ambient], resistance: 1}]
outputs: sensors
"""
    assert [each.place for each in _faults(text)] == ["nodes.a", "nodes.b"]
    parse_circuit(text.replace("[c, chip]", "[c, b]").replace("[a, ambient]", "[a, chip]"), "chain.yaml")


def test_inputs_in_parallel_balance_a_heat_and_need_a_measured_node():
    assert load_circuit("model1_kirchhoff").outputs == (Output("ambient", {}, {}, None, "q_e"),)
    balanced = EXAMPLE.replace("{board_degC: w}", "parallel").replace('  w: {unit: "1", initial: 1, free: false}\n', "")
    circuit = parse_circuit(balanced, "two.yaml")
    assert circuit.outputs == (Output("ambient", None, {}, None, "outputs.ambient.heat"),)
    assert circuit.parameters[-1] == Parameter("outputs.ambient.heat", "W", 0.0, 0.0, 0.0, False)
    text = EXAMPLE.replace("form: rise", "form: temperature").replace("{board_degC: w}", "parallel")
    assert [each.place for each in _faults(text)] == ["outputs.ambient.inputs", "parameters.w"]


def test_a_signal_and_a_sensor_of_one_column_are_one_input_and_a_power_counts_in_its_unit():
    text = EXAMPLE.replace("outputs:\n", "sources: [{into: board, signal: chip_degC}]\noutputs:\n")
    for source, value in (("chip_degC, share: 2", 2.0), ("p_kW, share: 2", 2.0), ("p_kW", 1000.0), ("p_W", 1.0)):
        circuit = parse_circuit(text.replace("chip_degC}]", f"{source}}}]"), "x")
        assert [each.initial for each in circuit.parameters if each.name == "sources[0].share"] == [value]
    assert parse_circuit(text, "x").inputs == ("board_degC", "chip_degC")


def test_a_file_gives_the_circuit_that_its_text_does_or_is_refused(tmp_path):
    path = tmp_path / "two.yaml"
    assert "cannot be read" in str(refused(load_circuit, str(path)))
    path.write_bytes(b"\xff\xfe\x00")
    assert "UTF-8" in str(refused(load_circuit, str(path)))
    path.write_text(EXAMPLE)
    assert load_circuit(str(path)) == parse_circuit(EXAMPLE, "two.yaml")


_WORDS = st.sampled_from(["board", "chip", "ambient", "C_board", "w", "parallel", "sensors", "1e3", "1e999", "{mend}"])
_ANYTHING = anything(st.integers(10**400, 10**401), _WORDS, st.dictionaries(st.just("board"), _WORDS))

_TEXTS = st.sampled_from([{}, {"outputs": "sensors"}]).flatmap(
    lambda changes: damaged({**yaml.safe_load(EXAMPLE), **changes}, _ANYTHING).map(yaml.safe_dump)
)
_DAMAGED = st.builds(
    lambda at, cut, put: EXAMPLE[:at] + put + EXAMPLE[at + cut :],
    st.integers(0, len(EXAMPLE) - 1),
    st.integers(0, 12),
    st.text("{}[]:,-#&*!|>'\"%@`\t\n\x00 a1", max_size=4),
)


@given(_TEXTS | _DAMAGED)
@settings(max_examples=160)
def test_anything_in_any_place_and_any_damage_is_taken_or_refused(text):
    with contextlib.suppress(Refused):
        assert isinstance(parse_circuit(text, "any.yaml"), Circuit)


ONE_NODE = {
    "format": "ambient-circuit",
    "version": 1,
    "name": "one",
    "about": "\x85 or \u2028 or \n breaks a line, \ufeff none: 20 \N{DEGREE SIGN}C",
    "form": "rise",
    "nodes": {"on": {"capacitance": 1.0, "sensor": "on"}},
    "edges": [{"between": ["on", "ambient"], "resistance": 1.0}],
    "outputs": {"ambient": {"states": "parallel"}},
}


@settings(max_examples=50)
@given(st.from_type(Circuit))
@example(parse_circuit(yaml.safe_dump(ONE_NODE), "one node"))
def test_every_circuit_comes_back(circuit):
    assert parse_circuit(write_circuit(circuit), "written") == circuit
