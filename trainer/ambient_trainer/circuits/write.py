"""A circuit back to its file: what ``circuits/schema.py`` reads from it is the same circuit, but for its comments."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Any

import yaml

from ambient_model.atomic import replacing
from ambient_trainer.circuits.circuit import Circuit, Node, Output, Parameter

_WIDTH = 120
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")


def save_circuit(path: str, circuit: Circuit) -> None:
    """Write ``circuit`` to a YAML file, whole or not at all; raises :class:`Refused` where it cannot be written."""
    with replacing(path) as stream:
        stream.write(write_circuit(circuit))


def write_circuit(circuit: Circuit) -> str:
    """The YAML of ``circuit``."""
    values = {each.name: _standing(each) for each in circuit.parameters}
    data = {
        "format": "ambient-circuit",
        "version": 1,
        "name": circuit.name,
        "about": circuit.about,
        "form": circuit.form,
        "hold": circuit.hold,
        "nodes": {node.name: _node(node, values) for node in circuit.nodes},
        "edges": [_Line(between=_Row(edge.between), resistance=values[edge.resistance]) for edge in circuit.edges],
        "sources": [
            _Line(into=source.into, signal=source.signal, share=values[source.share]) for source in circuit.sources
        ],
        "outputs": {output.name: _output(output, values) for output in circuit.outputs},
        "parameters": {each.name: _parameter(each) for each in circuit.parameters if _NAME.fullmatch(each.name)},
    }
    filled = {key: value for key, value in data.items() if value not in ({}, [])}
    return yaml.dump(filled, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=_WIDTH)


def _standing(parameter: Parameter) -> str | float:
    """What stands where ``parameter`` is used: what the file gave as a bare number has no name that could."""
    return parameter.name if _NAME.fullmatch(parameter.name) else parameter.initial


def _node(node: Node, values: Mapping[str, str | float]) -> _Line:
    line = _Line()
    if node.capacitance is not None:
        line["capacitance"] = values[node.capacitance]
    if node.sensor is not None:
        line["sensor"] = node.sensor
    return line


def _output(output: Output, values: Mapping[str, str | float]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    if output.states is None:
        found["states"] = "parallel"
    elif output.states:
        found["states"] = _Line({node: values[name] for node, name in output.states.items()})
    if output.heat is not None:
        found["inputs"] = "parallel"
        found["heat"] = values[output.heat]
    elif output.inputs:
        found["inputs"] = _Line({column: values[name] for column, name in output.inputs.items()})
    if output.offset is not None:
        found["offset"] = values[output.offset]
    return found


def _parameter(parameter: Parameter) -> _Line:
    line = _Line(unit=parameter.unit, initial=parameter.initial)
    if math.isfinite(parameter.low):
        line["min"] = parameter.low
    if math.isfinite(parameter.high):
        line["max"] = parameter.high
    if not parameter.free:
        line["free"] = False
    return line


class _Line(dict[str, Any]):
    """A mapping that is written in one line."""


class _Row(tuple[str, ...]):
    """A list that is written in one line."""


class _Dumper(yaml.SafeDumper):
    """Writes one line a node, an edge, a source and a parameter."""

    def ignore_aliases(self, data: Any) -> bool:
        """Every value stands where it is used."""
        return True


def _text(dumper: yaml.SafeDumper, text: str) -> yaml.Node:
    # in quotes what breaks lines is escaped; without, some of it comes back as a space
    return dumper.represent_scalar("tag:yaml.org,2002:str", text, style=None if text.isprintable() else '"')


_Dumper.add_representer(str, _text)
_Dumper.add_representer(
    _Line, lambda dumper, line: dumper.represent_mapping("tag:yaml.org,2002:map", line.items(), flow_style=True)
)
_Dumper.add_representer(
    _Row, lambda dumper, row: dumper.represent_sequence("tag:yaml.org,2002:seq", row, flow_style=True)
)
