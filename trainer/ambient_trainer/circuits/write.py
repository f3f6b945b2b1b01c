"""A circuit back to its file: what ``circuits/schema.py`` reads from it is the same circuit, but for its comments."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Any

import yaml

from ambient_model.atomic import replacing
from ambient_trainer.circuits.circuit import Addition, Circuit, Output, Parameter

_WIDTH = 120
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")


def save_circuit(path: str, circuit: Circuit) -> None:
    """Write ``circuit`` to a YAML file, whole or not at all; raises :class:`Refused` where it cannot be written."""
    with replacing(path) as stream:
        stream.write(write_circuit(circuit))


def write_circuit(circuit: Circuit) -> str:
    """The YAML of ``circuit``."""
    named = [each for each in circuit.parameters if _NAME.fullmatch(each.name)]
    # what the file gave as a bare number has no name that could stand for it
    values: dict[str | None, str | float] = {each.name: each.initial for each in circuit.parameters}
    values |= {each.name: each.name for each in named}
    data = {
        "format": "ambient-circuit",
        "version": 1,
        "name": circuit.name,
        "about": circuit.about,
        "form": circuit.form,
        "hold": circuit.hold,
        "nodes": {
            node.name: _Line(_given(capacitance=values.get(node.capacitance), sensor=node.sensor))
            for node in circuit.nodes
        },
        "edges": [_Line(between=list(edge.between), resistance=values[edge.resistance]) for edge in circuit.edges],
        "sources": [_Line(into=each.into, signal=each.signal, share=values[each.share]) for each in circuit.sources],
        "outputs": {output.name: _output(output, values) for output in circuit.outputs},
        "parameters": {each.name: _parameter(each) for each in named},
        "mechanisms": [_mechanism(each) for each in circuit.mechanisms],
    }
    filled = {key: value for key, value in data.items() if value not in ({}, [])}
    return yaml.dump(filled, Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=_WIDTH)


def _output(output: Output, values: Mapping[str | None, str | float]) -> dict[str, Any]:
    def weights(names: Mapping[str, str]) -> _Line | None:
        return _Line({each: values[name] for each, name in names.items()}) or None

    return _given(
        states="parallel" if output.states is None else weights(output.states),
        inputs=weights(output.inputs) if output.heat is None else "parallel",
        heat=values.get(output.heat),
        offset=values.get(output.offset),
    )


def _parameter(parameter: Parameter) -> _Line:
    low, high = (bound if math.isfinite(bound) else None for bound in (parameter.low, parameter.high))
    free = None if parameter.free else False
    return _Line(_given(unit=parameter.unit, initial=parameter.initial, min=low, max=high, free=free))


def _mechanism(each: Addition) -> dict[str, Any]:
    numbers = {name: _Line(number) for name, number in each.numbers.items()}
    return _given(**{**vars(each), "at": list(each.at), "numbers": numbers, "settings": _Line(each.settings) or None})


def _given(**entries: Any) -> dict[str, Any]:
    return {key: value for key, value in entries.items() if value is not None}


class _Line(dict[str, Any]):
    """A mapping that is written in one line."""


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
