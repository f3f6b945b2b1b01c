"""A circuit file is YAML, taken whole or refused with every fault and its place in one message.

Its keys stand in the documentation, ``reference/circuit.md``. A number may stand wherever a parameter's name does; it
is then fixed. ``mechanisms`` holds what ``diagnose --extended`` writes beyond that; only a simulation knows them.
Resistances and capacitances are positive by construction.
"""

import contextlib
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, ValidationInfo, model_validator

from ambient_model.faults import Fault, Refused, refuse
from ambient_trainer.circuits.circuit import AMBIENT, Addition, Circuit, Edge, Form, Node, Output, Parameter, Source
from ambient_trainer.data.strict_yaml import Strict, load_yaml, parse_yaml, shipped_path, validated, wrong
from ambient_trainer.data.units import watts_per_unit
from ambient_trainer.lti.statespace import Hold

_Name = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_]*$")]


def _named_or_number(value: Any) -> str | float:
    if isinstance(value, str) and re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", value):
        return value
    if isinstance(value, (int, float, str)) and not isinstance(value, bool):
        # text too: YAML 1.1 reads 1e3 as one
        with contextlib.suppress(ValueError, OverflowError):
            if math.isfinite(number := float(value)):
                return number
    raise wrong(f"{value!r:.40} is neither a name nor a number", "name a parameter or give a finite number")


def _weights_or_parallel(value: Any, info: ValidationInfo) -> Any:
    if isinstance(value, dict) or value == _PARALLEL:
        return value if isinstance(value, dict) else {_PARALLEL: 0.0}
    each = {"states": "node", "inputs": "column"}[str(info.field_name)]
    raise wrong(f"{value!r:.40} are no weights", f"write '{_PARALLEL}', or a weight for each {each}")


_LIBRARY = Path(__file__).with_name("library")
_PARALLEL = "parallel"
_SMALLEST, _LARGEST = 1e-9, 1e15
"""J/K or K/W; what is smaller or larger is a wrong unit."""
_Value = Annotated[Any, BeforeValidator(_named_or_number)]
_Weights = Annotated[dict[_Name, _Value], BeforeValidator(_weights_or_parallel)]


class _Node(Strict):
    capacitance: _Value | None = None
    sensor: _Name | None = None


class _Edge(Strict):
    between: tuple[_Name, _Name]
    resistance: _Value


class _Source(Strict):
    into: _Name
    signal: _Name
    share: _Value | None = None


class _Output(Strict):
    states: _Weights = Field(default_factory=dict)
    inputs: _Weights = Field(default_factory=dict)
    offset: _Value | None = None
    heat: _Value | None = None


class _Parameter(Strict):
    unit: str
    initial: float
    min: float | None = None
    max: float | None = None
    free: bool = True


class _Quantity(Strict):
    unit: str
    value: float
    log: bool = False
    scale: float = Field(default=1.0, gt=0)

    def _wrong(self) -> Iterator[tuple[str, str]]:
        if self.log and self.value <= 0:
            yield f"{self.value:g} has no logarithm", "give a number above 0, or leave out 'log'"


class _Mechanism(Strict):
    kind: _Name
    at: tuple[str, ...] = ()
    by: str | None = None
    from_s: float | None = None
    to_s: float | None = None
    numbers: dict[str, _Quantity]
    settings: dict[str, Any] = Field(default_factory=dict)


class _File(Strict):
    format: Literal["ambient-circuit"]
    version: Literal[1]
    name: Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_-]*$")]
    about: str = ""
    form: Form
    hold: Hold = "first-order"
    nodes: dict[_Name, _Node]
    edges: list[_Edge] = Field(default_factory=list)
    sources: list[_Source] = Field(default_factory=list)
    outputs: dict[_Name, _Output]
    parameters: dict[_Name, _Parameter] = Field(default_factory=dict)
    mechanisms: list[_Mechanism] = Field(default_factory=list)

    @model_validator(mode="before")
    @classmethod
    def _every_sensor(cls, data: Any) -> Any:
        """``outputs: sensors`` is short for one output a sensor on a state."""
        if not isinstance(data, dict) or data.get("outputs") != "sensors" or not isinstance(data.get("nodes"), dict):
            return data
        nodes = [(name, node) for name, node in data["nodes"].items() if isinstance(node, dict)]
        states = [(name, node.get("sensor")) for name, node in nodes if "capacitance" in node]
        outputs = {sensor: {"states": {name: 1.0}} for name, sensor in states if isinstance(sensor, str)}
        return {**data, "outputs": outputs}


def circuit_names() -> tuple[str, ...]:
    """The names of the shipped circuits."""
    return tuple(sorted(path.stem for path in _LIBRARY.glob("*.yaml")))


def load_circuit(name_or_path: str, besides: Sequence[str] = ()) -> Circuit:
    """The shipped circuit of that name, or the one in a YAML file; raises :class:`Refused` with every fault.

    ``besides`` are names that the caller takes itself, for the message.
    """
    path = shipped_path("circuit", name_or_path, _LIBRARY, circuit_names(), besides)
    return circuit_of_data(load_yaml(path), path)


def parse_circuit(text: str, source: str) -> Circuit:
    """The circuit that ``text`` describes; ``source`` names it in messages. Raises :class:`Refused`."""
    return circuit_of_data(parse_yaml(text, source), source)


def circuit_of_data(data: Any, source: str) -> Circuit:
    """The circuit that the content of a file describes."""
    if data is None:
        raise refuse(source, "", "the file is empty", "see the README for a circuit to start from")
    return _Reading(validated(_File, data, source)).circuit(source)


class _Reading:
    """The checks that need the parts together; every fault is noted, then all are said."""

    def __init__(self, file: _File) -> None:
        self.file = file
        self.faults: list[Fault] = []
        self.parameters = {name: self._parameter(name, each) for name, each in file.parameters.items()}
        self.used: dict[str, str] = {}
        """Per parameter the unit of what it stands for."""

    def _fault(self, place: str, problem: str, hint: str) -> None:
        self.faults.append(Fault(place, problem, hint))

    def circuit(self, source: str) -> Circuit:
        file = self.file
        circuit = Circuit(
            **file.model_dump(include={"name", "about", "form", "hold"}),
            nodes=tuple(self._node(name, node) for name, node in file.nodes.items()),
            edges=tuple(self._edge(index, edge) for index, edge in enumerate(file.edges)),
            sources=tuple(self._source(index, each) for index, each in enumerate(file.sources)),
            outputs=tuple(self._outputs()),
            parameters=tuple(self.parameters.values()),
            mechanisms=tuple(Addition(**each.model_dump()) for each in file.mechanisms),
        )
        self._check(circuit)
        if self.faults:
            raise Refused(source, self.faults)
        return circuit

    def _parameter(self, name: str, each: _Parameter) -> Parameter:
        low, high = -math.inf if each.min is None else each.min, math.inf if each.max is None else each.max
        if not low <= each.initial <= high:
            self._fault(f"parameters.{name}.initial", f"{each.initial:g} lies outside min and max", "move it inside")
        return Parameter(name, each.unit, each.initial, low, high, each.free and low < high)

    def _value(self, place: str, value: str | float, unit: str, positive: bool = False) -> str:
        """The name of the parameter that stands at ``place``, made where a number does."""
        if isinstance(value, str):
            if value not in self.parameters:
                self._fault(place, f"no parameter is called {value!r}", "add it under 'parameters'")
                return value
            name = value
        else:
            name = place
            self.parameters[name] = Parameter(name, unit, float(value), float(value), float(value), free=False)
        if self.used.setdefault(name, unit) != unit:
            self._fault(place, f"{name!r} is in {self.used[name]} elsewhere", f"name one in {unit} of its own")
        parameter = self.parameters[name]
        what = place.rpartition(".")[2]
        if positive and parameter.initial <= 0:
            self._fault(place, f"{what} {name} starts at {parameter.initial:g}", f"a {what} is above 0")
        elif positive and not _SMALLEST <= parameter.initial <= _LARGEST:
            self._fault(place, f"{what} {name} starts at {parameter.initial:g}", f"check its unit, {unit}")
        elif positive:  # bounds that a logarithm can search: within six decades of where it starts
            low, high = max(parameter.low, parameter.initial * 1e-6), min(parameter.high, parameter.initial * 1e6)
            self.parameters[name] = replace(parameter, low=low, high=high)
        return name

    def _node(self, name: str, node: _Node) -> Node:
        place = f"nodes.{name}"
        if name == AMBIENT and node.capacitance is not None:
            self._fault(place, "the ambient has a capacitance", "it is a boundary: remove the capacitance")
        if name != AMBIENT and node.capacitance is None and node.sensor is None:
            self._fault(place, "neither capacitance nor sensor", "a node is a state, or a sensor prescribes it")
        if self.file.form == "rise" and (node.sensor is None) != (name == AMBIENT):
            self._fault(place, "no sensor" if node.sensor is None else "a sensor", _RISE_SENSORS)
        capacitance = None
        if node.capacitance is not None:
            capacitance = self._value(f"{place}.capacitance", node.capacitance, "J/K", positive=True)
        return Node(name, capacitance, node.sensor)

    def _edge(self, index: int, edge: _Edge) -> Edge:
        place = f"edges[{index}]"
        for name in edge.between:
            if name != AMBIENT and name not in self.file.nodes:
                self._fault(f"{place}.between", f"no node is called {name!r}", "add it under 'nodes'")
        if edge.between[0] == edge.between[1]:
            self._fault(f"{place}.between", f"{edge.between[0]!r} is both ends", "an edge joins two nodes")
        return Edge(edge.between, self._value(f"{place}.resistance", edge.resistance, "K/W", positive=True))

    def _source(self, index: int, source: _Source) -> Source:
        place = f"sources[{index}]"
        node = self.file.nodes.get(source.into)
        if node is None or node.capacitance is None:
            self._fault(f"{place}.into", f"{source.into!r} is no node with a capacitance", "heat goes into a state")
        share = watts_per_unit(source.signal) if source.share is None else source.share
        return Source(source.into, source.signal, self._value(f"{place}.share", share, "1"))

    def _outputs(self) -> Iterator[Output]:
        for name, output in self.file.outputs.items():
            place = f"outputs.{name}"
            states = None if _PARALLEL in output.states else self._weights(f"{place}.states", output.states)
            balanced = _PARALLEL in output.inputs
            inputs = {} if balanced else self._weights(f"{place}.inputs", output.inputs)
            offset = None if output.offset is None else self._value(f"{place}.offset", output.offset, "degC")
            if output.heat is not None and not balanced:
                self._fault(f"{place}.heat", "nothing balances it", f"it goes with 'inputs: {_PARALLEL}'")
            heat = self._value(f"{place}.heat", output.heat or 0.0, "W") if balanced else None
            yield Output(name, states, inputs, offset, heat)

    def _weights(self, place: str, weights: Mapping[str, str | float]) -> dict[str, str]:
        return {name: self._value(f"{place}.{name}", value, "1") for name, value in weights.items()}

    def _check(self, circuit: Circuit) -> None:
        states = {node.name for node in circuit.states}
        for output in circuit.outputs:
            place, weighs = f"outputs.{output.name}", "'parallel' weighs those"
            for node in (each for each in output.states or () if each not in states):
                self._fault(f"{place}.states", f"{node!r} is no node with a capacitance", "name a state")
            for column in (each for each in output.inputs if each not in circuit.inputs):
                self._fault(f"{place}.inputs", f"{column!r} is no input", f"inputs are {', '.join(circuit.inputs)}")
            if output.column in circuit.inputs:
                self._fault(place, f"{output.column!r} is an input too", "predict what is not read")
            if output.states is None and not circuit.to_ambient(circuit.states):
                self._fault(f"{place}.states", "no edge leads to the ambient", weighs)
            if output.heat is not None and not circuit.to_ambient(circuit.measured):
                self._fault(f"{place}.inputs", "no edge leads from a measured node to the ambient", weighs)
        sensors = [each.sensor for each in circuit.nodes]
        for index, each in enumerate(circuit.nodes):
            if each.sensor is not None and each.sensor in sensors[:index]:
                self._fault(f"nodes.{each.name}.sensor", f"{each.sensor!r} reads another node", "it can read only one")
        if not circuit.outputs:
            self._fault("outputs", "none", "a circuit predicts at least one temperature")
        if not circuit.inputs:
            self._fault("nodes", "nothing drives the circuit", _DRIVEN[circuit.form])
        for name in sorted(states - _drained(circuit)):
            self._fault(f"nodes.{name}", "has no thermal path to a boundary", _PATH_HINT[circuit.form])
        for name in self.parameters:
            if name not in self.used:
                self._fault(f"parameters.{name}", "nothing uses it", "remove it, or name it where it belongs")


_RISE_SENSORS = "in form rise every node but the ambient has one: the exchange between nodes is read from them"
_DRIVEN = {
    "rise": "give a sensor to a node without capacitance",
    "temperature": "add what drives it, such as 'ambient: {sensor: ambient}'",
}
_PATH_HINT = {
    "rise": "join it to the ambient",
    "temperature": "join it, directly or through others, to a node that a sensor prescribes",
}


def _drained(circuit: Circuit) -> set[str]:
    """The nodes whose heat reaches what takes any: the ambient, or in temperature form every prescribed node."""
    if circuit.form == "rise":
        return {edge.other(AMBIENT) for edge in circuit.edges if AMBIENT in edge.between}
    drained = {node.name for node in circuit.nodes if node.capacitance is None and node.sensor is not None}
    for _ in circuit.nodes:
        drained |= {name for edge in circuit.edges for name in edge.between if edge.other(name) in drained}
    return drained
