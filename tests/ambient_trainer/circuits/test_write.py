"""What is read back from a written circuit is the same circuit, whatever is in it."""

import yaml
from hypothesis import example, given, settings
from hypothesis import strategies as st

from ambient_trainer.circuits.schema import load_circuit, parse_circuit
from ambient_trainer.circuits.write import write_circuit

NAMES = ("on", "no", "null", "nan", "e5", "y", "board", "Shell_2", "x", "true", "INF", "k_board_cpu_power_W")
TEXT = st.text(st.characters(exclude_categories=("Cs",)), max_size=30)


@st.composite
def values(draw, parameters, kind, unit, positive):
    """A number, or the name of a new or an old parameter of the same kind, which is noted in ``parameters``."""
    size = st.floats(1e-6, 1e6) if positive else st.floats(-1e6, 1e6)
    old = sorted(name for name in parameters if name.startswith(kind))
    choice = draw(st.integers(0, 2))
    if choice == 0:
        return draw(size)
    if choice == 1 and old:
        return draw(st.sampled_from(old))
    initial = draw(size)
    parameter = {"unit": unit, "initial": initial}
    if draw(st.booleans()):
        parameter["min"] = draw(st.floats(1e-9 if positive else -1e9, initial))
    if draw(st.booleans()):
        parameter["max"] = draw(st.floats(initial, 1e9))
    if draw(st.booleans()):
        parameter["free"] = draw(st.booleans())
    name = f"{kind}_{len(parameters)}"
    parameters[name] = parameter
    return name


@st.composite
def circuit_files(draw):
    """A circuit file's content that is valid by construction."""
    form = draw(st.sampled_from(("rise", "temperature")))
    names = draw(st.permutations(NAMES))
    states, prescribed = names[: draw(st.integers(1, 4))], names[4 : 4 + draw(st.integers(0, 2))]
    parameters = {}

    def value(kind, unit, positive=False):
        return draw(values(parameters, kind, unit, positive))

    nodes = {name: {"capacitance": value("C", "J/K", True)} for name in states}
    for name in states:
        # at least one input and one output
        if form == "rise" or name == states[0] or draw(st.booleans()):
            nodes[name]["sensor"] = name
    nodes |= {name: {"sensor": name} for name in prescribed}
    if form == "temperature":
        nodes["ambient"] = {"sensor": "ambient"}
    edges = [{"between": [name, "ambient"], "resistance": value("R", "K/W", True)} for name in states]
    pairs = st.lists(st.sampled_from(list(nodes)), min_size=2, max_size=2, unique=True)
    for pair in draw(st.lists(pairs, max_size=4)) if len(nodes) > 1 else ():
        edges.append({"between": pair, "resistance": value("R", "K/W", True)})
    sources = [
        {"into": draw(st.sampled_from(states)), "signal": signal, "share": value("k", draw(TEXT))}
        for signal in draw(st.lists(st.sampled_from(("cpu_power_W", "charging_on", "off")), max_size=3))
    ]
    data = {
        "format": "ambient-circuit",
        "version": 1,
        "name": draw(st.sampled_from(NAMES)),
        "about": draw(TEXT),
        "form": form,
        "hold": draw(st.sampled_from(("first-order", "zero-order"))),
        "nodes": nodes,
        "edges": edges,
        "sources": sources,
    }
    if form == "temperature":
        data["outputs"] = "sensors"
    else:
        some = st.lists(st.sampled_from(states), unique=True)
        output = {"states": "parallel"}
        if draw(st.booleans()):
            output["states"] = {name: value("w", "1") for name in draw(some)}
        if draw(st.booleans()):
            output |= {"inputs": "parallel", "heat": value("q", "W")}
        else:
            output["inputs"] = {f"{name}_degC": value("w", "1") for name in draw(some)}
        if draw(st.booleans()):
            output["offset"] = value("m", "degC")
        data["outputs"] = {"ambient": output}
    return {**data, "parameters": parameters}


ONE_NODE = {
    "format": "ambient-circuit",
    "version": 1,
    "name": "one",
    "form": "rise",
    "nodes": {"on": {"capacitance": 1.0, "sensor": "on"}},
    "edges": [{"between": ["on", "ambient"], "resistance": 1.0}],
    "outputs": {"ambient": {"states": "parallel"}},
}


@settings(max_examples=50, deadline=None)
@given(circuit_files())
@example({**ONE_NODE, "about": "\x85 or \u2028 or \n breaks a line, \ufeff none: 20 \N{DEGREE SIGN}C"})
def test_every_circuit_comes_back(data):
    circuit = parse_circuit(yaml.safe_dump(data, sort_keys=False), "generated")
    written = write_circuit(circuit)
    assert parse_circuit(written, "written") == circuit
    assert list(yaml.safe_load(written)["nodes"]) == list(data["nodes"])


def test_one_line_stands_for_each_part():
    lines = write_circuit(load_circuit("model1_kirchhoff")).splitlines()
    assert "- {between: [usb, ambient], resistance: R_usb_ambient}" in lines
    assert "  q_e: {unit: W, initial: 1.0, free: false}" in lines
    assert "    inputs: parallel" in lines
    assert "    heat: q_e" in lines
