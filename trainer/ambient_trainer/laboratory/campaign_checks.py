"""What is wrong between the parts of a campaign file, told along with what is wrong inside them.

The parts are looked at as they came, before their own check: what has not the shape to be compared is left to that.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from typing import Any

from ambient_model.faults import Fault
from ambient_model.trace import REFERENCE, split_column

_UNITS = {"temp": "degC", "current_now": "A", "voltage_now": "V"}


def faults_between(data: Any, ports: bool) -> Iterator[Fault]:
    """Every such fault in the ``data`` of a campaign file; ``ports``: also where a port is not there."""
    laboratory = _mapping(data, "laboratory")
    yield from _port_faults(_mapping(laboratory, "instruments"), ports)
    yield from _probe_faults(laboratory)
    yield from _column_faults(laboratory)
    yield from _action_faults(laboratory)
    yield from _safety_faults(laboratory)
    for part in ("before", "steps"):
        for index, step in enumerate(_sequence(data, part)):
            yield from _step_faults(f"{part}[{index}]", step, laboratory)


def _port_faults(instruments: dict[Any, Any], ports: bool) -> Iterator[Fault]:
    taken: dict[str, str] = {}
    for name, link in instruments.items():
        port = _mapping(link).get("port")
        if not isinstance(port, str):
            continue
        place = f"laboratory.instruments.{name}.port"
        first = taken.setdefault(os.path.realpath(port), str(name))
        if first != name:
            yield Fault(place, f"{port} is the {first}'s, too", "each instrument has a port of its own")
        if ports and not os.path.exists(port):
            yield Fault(place, f"{port} is not there", "plug the adapter in, or name its port (see /dev/serial/by-id)")


def _probe_faults(laboratory: dict[Any, Any]) -> Iterator[Fault]:
    probes = _mapping(_mapping(_mapping(laboratory, "instruments"), "multiplexer"), "probes")
    channels: dict[Any, Any] = {}
    for name, channel in probes.items():
        first = channels.setdefault(repr(channel), name)
        if first != name:
            place = f"laboratory.instruments.multiplexer.probes.{name}"
            yield Fault(place, f"channel {channel} is the probe {first}'s, too", "each probe has a channel of its own")
    ambient = _mapping(laboratory, "ambient")
    named = _sequence(ambient, "probes")
    for index, name in enumerate(named):
        place = f"laboratory.ambient.probes[{index}]"
        if probes and str(name) not in map(str, probes):
            known = ", ".join(map(str, probes))
            yield Fault(place, f"the multiplexer has no probe {name!r}", f"name one of {known}")
        if name in named[:index]:
            yield Fault(place, f"{name!r} stands twice", "name each probe once")
    if named and _number(ambient.get("at_least"), 1.0) > len(named):
        problem = f"asks for {ambient['at_least']} of {len(named)} probes"
        yield Fault("laboratory.ambient.at_least", problem, "ask for as many as there are, or fewer")


def offset_faults(data: Any, offsets: Iterable[str]) -> Iterator[Fault]:
    """The probes of the file of ``offsets`` that the laboratory has not."""
    laboratory = _mapping(data, "laboratory")
    probes = _mapping(_mapping(_mapping(laboratory, "instruments"), "multiplexer"), "probes")
    for name in offsets:
        if name not in probes:
            yield Fault(
                "laboratory.ambient.offsets", f"has an offset for {name!r}", "the multiplexer has no such probe"
            )


def _column_faults(laboratory: dict[Any, Any]) -> Iterator[Fault]:
    device = _mapping(laboratory, "device")
    supply = _mapping(_mapping(device, "power_supply"), "columns")
    wanted = [(f"laboratory.device.zones.{zone}", each, "degC") for zone, each in _mapping(device, "zones").items()]
    wanted += [
        (f"laboratory.device.power_supply.columns.{attribute}", each, _UNITS.get(str(attribute), ""))
        for attribute, each in supply.items()
    ]
    wanted += [(f"laboratory.signals.{each}", each, "") for each in _mapping(laboratory, "signals")]
    taken = {REFERENCE: "the reference", "time_s": "the time"}
    for place, column, unit in wanted:
        if not isinstance(column, str):
            continue
        name, has = split_column(column)
        if not name or not column.isprintable() or "," in column or '"' in column:
            yield Fault(place, f"{column!r} names no unit", "name it <name>_<unit>, such as usb_degC")
        elif unit and has != unit:
            yield Fault(place, f"{column!r} is in {has}", f"it comes in {unit}: name it {name}_{unit}")
        if column in taken:
            yield Fault(place, f"{column!r} is {taken[column]}, too", "give each column a name of its own")
        taken.setdefault(column, place)


def _action_faults(laboratory: dict[Any, Any]) -> Iterator[Fault]:
    signals = _mapping(laboratory, "signals")
    for name, action in _mapping(laboratory, "actions").items():
        for signal in _mapping(action, "signals"):
            if signal not in signals:
                place = f"laboratory.actions.{name}.signals.{signal}"
                yield Fault(place, "no such signal", "add it under 'signals', with its value at rest")


def _safety_faults(laboratory: dict[Any, Any]) -> Iterator[Fault]:
    safety = _mapping(laboratory, "safety")
    low, high = _limits(laboratory)
    if low is not None and high is not None and not low < high:
        yield Fault("laboratory.safety.chamber", f"{low:g} to {high:g} degC holds nothing", "low lies below high")
    yield from _outside("laboratory.safety.set_point_degC", safety.get("set_point_degC"), laboratory)
    device = _mapping(laboratory, "device")
    columns = [*_mapping(device, "zones").values()]
    columns += [*_mapping(_mapping(device, "power_supply"), "columns").values()]
    for column in _mapping(safety, "device_high_degC"):
        if column not in columns or not str(column).endswith("_degC"):
            place = f"laboratory.safety.device_high_degC.{column}"
            yield Fault(place, "the device has no such temperature", "name a column of its zones")


def _step_faults(place: str, step: Any, laboratory: dict[Any, Any]) -> Iterator[Fault]:
    yield from _outside(f"{place}.chamber_degC", _mapping(step).get("chamber_degC"), laboratory)
    actions = _mapping(laboratory, "actions")
    for index, name in enumerate(_sequence(step, "load")):
        if name not in actions:
            known = ", ".join(map(str, actions)) or "none"
            yield Fault(f"{place}.load[{index}]", f"no action is called {name!r}", f"known are {known}")
    settle = _mapping(step, "settle")
    if _number(settle.get("for_min"), 0.0) > _number(settle.get("at_most_min"), 240.0):
        yield Fault(f"{place}.settle", "'for_min' is longer than 'at_most_min'", "it could never settle: swap them")


def _outside(place: str, value: Any, laboratory: dict[Any, Any]) -> Iterator[Fault]:
    low, high = _limits(laboratory)
    if not isinstance(value, (int, float)) or isinstance(value, bool):
        return
    if (low is not None and value < low) or (high is not None and value > high):
        limits = f"{'?' if low is None else f'{low:g}'} to {'?' if high is None else f'{high:g}'} degC"
        yield Fault(place, f"{value:g} degC is outside the chamber's limits", f"stay within {limits}")


def _limits(laboratory: dict[Any, Any]) -> tuple[float | None, float | None]:
    chamber = _mapping(_mapping(laboratory, "safety"), "chamber")
    found = []
    for key in ("low_degC", "high_degC"):
        value = chamber.get(key)
        found.append(float(value) if isinstance(value, (int, float)) and not isinstance(value, bool) else None)
    return found[0], found[1]


def _mapping(data: Any, key: str | None = None) -> dict[Any, Any]:
    inner = data if key is None else (data.get(key) if isinstance(data, dict) else None)
    return inner if isinstance(inner, dict) else {}


def _sequence(data: Any, key: str) -> list[Any]:
    inner = _mapping(data).get(key)
    return inner if isinstance(inner, list) else []


def _number(value: Any, otherwise: float) -> float:
    return float(value) if isinstance(value, (int, float)) and not isinstance(value, bool) else otherwise
