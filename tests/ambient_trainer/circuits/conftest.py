"""Any valid circuit, for hypothesis: ``st.from_type(Circuit)``."""

import yaml
from hypothesis import strategies as st

from ambient_trainer.circuits.circuit import Circuit
from ambient_trainer.circuits.schema import parse_circuit

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
def circuits(draw):
    """What a circuit file holds that is valid by construction; several places may share a parameter."""
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
    boundary = "ambient" if form == "rise" or not prescribed or draw(st.booleans()) else prescribed[0]
    if form == "temperature" and boundary == "ambient":
        nodes["ambient"] = {"sensor": "ambient"}
    edges = [{"between": [name, boundary], "resistance": value("R", "K/W", True)} for name in states]
    pairs = st.lists(st.sampled_from([*nodes, "ambient"]), min_size=2, max_size=2, unique=True)
    for pair in draw(st.lists(pairs.filter(lambda pair: form == "temperature" or "ambient" not in pair), max_size=4)):
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
    return parse_circuit(yaml.safe_dump({**data, "parameters": parameters}, sort_keys=False), "generated")


st.register_type_strategy(Circuit, circuits())
