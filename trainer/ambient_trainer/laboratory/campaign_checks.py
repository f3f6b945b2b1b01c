"""Faults between the parts of a campaign file, reported along with those inside a part.

The parts are compared as they stand in the file, before their own check: what has not the shape to be compared is left
to that.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from typing import Any

from ambient_model.faults import Fault
from ambient_model.trace import REFERENCE
from ambient_trainer.simulator.scenario import Settle

_DEFAULTS = {"at_most_min": Settle.model_fields["at_most_min"].default}


def faults_between(data: Any, ports: bool, offsets: Iterable[str] = ()) -> Iterator[Fault]:
    """Every such fault in the ``data`` of a campaign file; ``ports``: also where a port is not there."""
    laboratory = _mapping(data, "laboratory")
    yield from _port_faults(_mapping(laboratory, "instruments"), ports)
    yield from _probe_faults(laboratory, offsets)
    yield from _column_faults(laboratory)
    yield from _outside("laboratory.safety", "set_point_degC", _mapping(laboratory, "safety"), laboratory)
    for name, action in _mapping(laboratory, "actions").items():
        for signal in _mapping(action, "signals"):
            if signal not in _mapping(laboratory, "signals"):
                place = f"laboratory.actions.{name}.signals.{signal}"
                yield Fault(place, "no such signal", "add it under 'signals', with its value while no action lasts")
    for part in ("before", "steps"):
        for index, step in enumerate(_sequence(data, part)):
            yield from _step_faults(f"{part}[{index}]", _mapping(step), laboratory)


def _port_faults(instruments: dict[Any, Any], ports: bool) -> Iterator[Fault]:
    owners: dict[str, str] = {}
    for name, settings in instruments.items():
        port = _mapping(settings).get("port")
        if not isinstance(port, str):
            continue
        place = f"laboratory.instruments.{name}.port"
        owner = owners.setdefault(os.path.realpath(port), str(name))
        if owner != name:
            yield Fault(place, f"{port} is the {owner}'s, too", "each instrument has a port of its own")
        if ports and not os.path.exists(port):
            yield Fault(place, f"{port} is not there", "plug the adapter in, or name its port (see /dev/serial/by-id)")


def _probe_faults(laboratory: dict[Any, Any], offsets: Iterable[str]) -> Iterator[Fault]:
    probes = _mapping(laboratory, "instruments", "multiplexer", "probes")
    for index, name in enumerate(_sequence(_mapping(laboratory, "ambient"), "probes")):
        if probes and str(name) not in map(str, probes):
            known = ", ".join(map(str, probes))
            place = f"laboratory.ambient.probes[{index}]"
            yield Fault(place, f"the multiplexer has no probe {name!r}", f"name one of {known}")
    for name in offsets:
        if name not in probes:
            place = "laboratory.ambient.offsets"
            yield Fault(place, f"has an offset for {name!r}", "the multiplexer has no such probe")


def _column_faults(laboratory: dict[Any, Any]) -> Iterator[Fault]:
    zones = _mapping(laboratory, "device", "zones")
    supply = _mapping(laboratory, "device", "power_supply", "columns")
    places = {f"laboratory.device.zones.{zone}": column for zone, column in zones.items()}
    places |= {f"laboratory.device.power_supply.columns.{name}": column for name, column in supply.items()}
    places |= {f"laboratory.signals.{column}": column for column in _mapping(laboratory, "signals")}
    owners = {REFERENCE: "the reference", "time_s": "the time"}
    for place, column in places.items():
        if isinstance(column, str):
            if column in owners:
                yield Fault(place, f"{column!r} is {owners[column]}, too", "give each column a name of its own")
            owners.setdefault(column, place)
    for column in _mapping(laboratory, "safety", "device_high_degC"):
        if column not in [*zones.values(), *supply.values()] or not str(column).endswith("_degC"):
            place = f"laboratory.safety.device_high_degC.{column}"
            yield Fault(place, "the device has no such temperature", "name a column of its zones")


def _step_faults(place: str, step: dict[Any, Any], laboratory: dict[Any, Any]) -> Iterator[Fault]:
    yield from _outside(place, "chamber_degC", step, laboratory)
    actions = _mapping(laboratory, "actions")
    for index, name in enumerate(_sequence(step, "load")):
        if name not in actions:
            known = ", ".join(map(str, actions)) or "none"
            yield Fault(f"{place}.load[{index}]", f"no action is called {name!r}", f"known are {known}")
    settle = {**_DEFAULTS, **_mapping(step, "settle")}
    for_min, at_most_min = _number(settle.get("for_min")), _number(settle["at_most_min"])
    if for_min is not None and at_most_min is not None and for_min > at_most_min:
        yield Fault(f"{place}.settle", "'for_min' is longer than 'at_most_min'", "it could never settle: swap them")


def _outside(place: str, key: str, part: dict[Any, Any], laboratory: dict[Any, Any]) -> Iterator[Fault]:
    limits = _mapping(laboratory, "safety", "chamber")
    value, low, high = _number(part.get(key)), _number(limits.get("low_degC")), _number(limits.get("high_degC"))
    if value is not None and ((low is not None and value < low) or (high is not None and value > high)):
        within = f"{'?' if low is None else f'{low:g}'} to {'?' if high is None else f'{high:g}'} degC"
        yield Fault(f"{place}.{key}", f"{value:g} degC is outside the chamber's limits", f"stay within {within}")


def _mapping(data: Any, *keys: str) -> dict[Any, Any]:
    for key in keys:
        data = data.get(key) if isinstance(data, dict) else None
    return data if isinstance(data, dict) else {}


def _sequence(data: Any, key: str) -> list[Any]:
    inner = _mapping(data).get(key)
    return inner if isinstance(inner, list) else []


def _number(value: Any) -> float | None:
    return float(value) if isinstance(value, (int, float)) and not isinstance(value, bool) else None
