"""The published parameters are data: tables 4.1 to 4.8 as printed, and what the errata correct in them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import Literal

from pydantic import Field

from ambient_model.faults import Fault, Refused
from ambient_trainer.circuits.schema import load_circuit
from ambient_trainer.data.strict_yaml import Strict, parse_yaml, validated


@dataclass(frozen=True)
class Published:
    """One model's parameters in the units of its circuit file.

    ``printed`` is the table; ``corrected`` the same with the values of the errata, whose numbers by parameter stand in
    ``errata``.
    """

    model: str
    table: str
    printed: Mapping[str, float]
    corrected: Mapping[str, float]
    errata: Mapping[str, int]


class _Correction(Strict):
    value: float
    erratum: int


class _Model(Strict):
    table: str
    published: dict[str, float]
    corrected: dict[str, _Correction] = Field(default_factory=dict)


class _File(Strict):
    format: Literal["thesis-parameters"]
    version: Literal[1]
    models: dict[str, _Model]


@cache
def published_parameters() -> Mapping[str, Published]:
    """The shipped tables by the models' names, in the order of the thesis."""
    source = "thesis/parameters.yaml"
    return parse_parameters((resources.files(__package__) / "parameters.yaml").read_text(), source)


def parse_parameters(text: str, source: str) -> Mapping[str, Published]:
    """The tables that ``text`` holds; raises :class:`Refused` where a table is not that of its circuit."""
    file = validated(_File, parse_yaml(text, source), source)
    faults = [fault for name, each in file.models.items() for fault in _faults(name, each)]
    if faults:
        raise Refused(source, faults)
    return {name: _published(name, each) for name, each in file.models.items()}


def _published(name: str, each: _Model) -> Published:
    corrections = {parameter: correction.value for parameter, correction in each.corrected.items()}
    errata = {parameter: correction.erratum for parameter, correction in each.corrected.items()}
    return Published(name, each.table, each.published, {**each.published, **corrections}, errata)


def _faults(name: str, each: _Model) -> list[Fault]:
    place = f"models.{name}"
    wanted = {parameter.name for parameter in load_circuit(name).parameters}
    missing, unknown = sorted(wanted - set(each.published)), sorted(set(each.published) - wanted)
    faults = [Fault(f"{place}.published", f"lacks {', '.join(missing)}", "add what the circuit has")] if missing else []
    if unknown:
        faults.append(Fault(f"{place}.published", f"{', '.join(unknown)}: not in the circuit", "remove it"))
    stray = sorted(set(each.corrected) - set(each.published))
    if stray:
        faults.append(Fault(f"{place}.corrected", f"{', '.join(stray)}: not published", "remove it"))
    return faults
