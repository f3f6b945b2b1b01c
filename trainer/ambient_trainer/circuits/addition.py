"""Extensions and changes of a circuit, each as a new circuit: nothing is checked here, writing it out is.

What is added starts at the value given and is free; every new name is one that the circuit does not have.
"""

from collections.abc import Collection, Mapping
from dataclasses import replace
from math import inf

from ambient_trainer.circuits.circuit import Circuit, Edge, Node, Parameter, Source


def with_values(circuit: Circuit, values: Mapping[str, float]) -> Circuit:
    """``circuit`` with its free parameters starting at ``values``; bounds give way to them."""
    started = (each for each in circuit.parameters if each.free and each.name in values)
    return _with(circuit, {each.name: _moved(each, values[each.name]) for each in started})


def started(circuit: Circuit, values: Mapping[str, float], held: Collection[str] = ()) -> Circuit:
    """``circuit`` with these initial values, within its bounds, and the parameters ``held`` no longer free."""
    parameters = []
    for each in circuit.parameters:
        initial = min(max(values.get(each.name, each.initial), each.low), each.high)
        parameters.append(replace(each, initial=initial, free=each.free and each.name not in held))
    return replace(circuit, parameters=tuple(parameters))


def with_source(circuit: Circuit, into: str, signal: str, share: float, unit: str) -> Circuit:
    """``circuit`` with heat of ``share`` (in ``unit``) times ``signal`` into one node, on top of what there is."""
    there = next((each for each in circuit.sources if (each.into, each.signal) == (into, signal)), None)
    known = next((each for each in circuit.parameters if there and each.name == there.share), None)
    if known is not None and known.free and sum(each.share == known.name for each in circuit.sources) == 1:
        return _with(circuit, {known.name: _moved(known, known.initial + share)})
    name = _unused(circuit, f"k_{into}_{signal}")
    added = replace(circuit, sources=(*circuit.sources, Source(into, signal, name)))
    return _with(added, {name: Parameter(name, unit, share, -inf, inf, free=True)})


def with_edge(circuit: Circuit, one: str, other: str, resistance_K_W: float) -> Circuit:
    """``circuit`` with one more thermal resistance between two nodes."""
    name = _unused(circuit, f"R_{one}_{other}")
    added = replace(circuit, edges=(*circuit.edges, Edge((one, other), name)))
    return _with(added, {name: Parameter(name, "K/W", resistance_K_W, 0.0, inf, free=True)})


def with_body(circuit: Circuit, neighbour: str, capacitance_J_K: float, resistance_K_W: float) -> Circuit:
    """``circuit`` with a body that no sensor reads on ``neighbour``."""
    body = _unused(circuit, f"{neighbour}_mass")
    name = _unused(circuit, f"C_{body}")
    added = replace(circuit, nodes=(*circuit.nodes, Node(body, name, None)))
    held = _with(added, {name: Parameter(name, "J/K", capacitance_J_K, 0.0, inf, free=True)})
    return with_edge(held, neighbour, body, resistance_K_W)


def _with(circuit: Circuit, parameters: Mapping[str, Parameter]) -> Circuit:
    """``circuit`` with ``parameters`` by name, in place of those it has or behind them."""
    names = {each.name for each in circuit.parameters}
    kept = [parameters.get(each.name, each) for each in circuit.parameters]
    return replace(circuit, parameters=(*kept, *(each for name, each in parameters.items() if name not in names)))


def _moved(parameter: Parameter, value: float) -> Parameter:
    """``parameter`` at ``value``, with bounds that leave it there."""
    if not parameter.low < parameter.high:
        return replace(parameter, initial=value, low=value, high=value)
    return replace(parameter, initial=value, low=min(parameter.low, value), high=max(parameter.high, value))


def _unused(circuit: Circuit, name: str) -> str:
    """``name``, or with a number behind it where the circuit has one already."""
    taken = {each.name for each in circuit.nodes} | {each.name for each in circuit.parameters}
    if name not in taken:
        return name
    return next(f"{name}_{number}" for number in range(2, len(taken) + 3) if f"{name}_{number}" not in taken)
