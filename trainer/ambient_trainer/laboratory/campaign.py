"""A campaign is data: a laboratory, and a program of steps that it runs through; refused whole, with every fault.

A laboratory is set up once and serves many programs: ``laboratory`` holds it, or names the file that does, beside the
campaign's own. The settings of an instrument are those of its kind.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

from pydantic import AfterValidator, Field, PositiveFloat, create_model, field_validator

from ambient_model.faults import Fault, Refused, refuse
from ambient_model.trace import REFERENCE, split_column
from ambient_trainer.data.probe_offsets import ProbeOffset, load_offsets
from ambient_trainer.data.strict_yaml import Strict, load_yaml, validated, wrong
from ambient_trainer.laboratory import instruments as kinds
from ambient_trainer.laboratory.instruments import ChamberLimits, ChamberSettings, Name
from ambient_trainer.laboratory.messages import CHAMBER, MULTIPLEXER, THERMOMETER
from ambient_trainer.laboratory.serial_line import is_missing
from ambient_trainer.simulator.scenario import Scenario

_SUPPLY_UNITS = {"temp": "degC", "current_now": "A", "voltage_now": "V"}


def _column(column: str, unit: str = "") -> str:
    """The column; raises for one that is no ``<name>_<unit>``, or of another unit."""
    name, has = split_column(column)
    if not name or not column.isprintable() or "," in column or '"' in column:
        raise wrong(f"{column!r} names no unit", "name it <name>_<unit>, such as usb_degC")
    if unit and has != unit:
        raise wrong(f"{column!r} is in {has}", f"it comes in {unit}: name it {name}_{unit}")
    return column


_Temperature = Annotated[float, Field(ge=-100, le=250)]
_Signal = Annotated[float, Field(ge=-1e6, le=1e6)]
_Column = Annotated[str, AfterValidator(_column)]
_TemperatureColumn = Annotated[str, AfterValidator(lambda column: _column(column, "degC"))]


class Instruments(Strict):
    """The instruments; on a desk there is no chamber."""

    chamber: ChamberSettings | None = None
    multiplexer: kinds.MultiplexerSettings | None = None
    thermometer: kinds.ThermometerSettings | None = None

    @property
    def named(self) -> dict[str, Any]:
        """Those that are there, by role."""
        return {role: settings for role, settings in self if settings is not None}


class Ambient(Strict):
    """The ambient is the mean of several probes in the chamber's middle, as in the thesis.

    With fewer than ``at_least`` that answer it is missing; ``offsets`` is the file that ``calibrate`` wrote. Without a
    multiplexer, ``probes`` is ``[thermometer]``.
    """

    probes: Annotated[tuple[Name, ...], Field(min_length=1)]
    at_least: Annotated[int, Field(ge=1)] = 1
    offsets: str | None = None

    def _wrong(self) -> Iterator[tuple[str, str]]:
        if twice := [name for index, name in enumerate(self.probes) if name in self.probes[:index]]:
            yield f"{twice[0]!r} is duplicated", "name each probe once"
        if self.at_least > len(self.probes):
            problem = f"'at_least' asks for {self.at_least} of {len(self.probes)} probes"
            yield problem, "ask for as many as there are, or fewer"

    def readings(self, values: Mapping[str, float | None]) -> dict[str, float | None]:
        """What each probe reads; a thermometer alone has a column of its own."""
        return {name: values.get(kinds.probe_column(name), values.get(f"{name}_degC")) for name in self.probes}

    def mean_degC(self, values: Mapping[str, float | None]) -> float | None:
        """The mean of the probes that answered, to the digits of a probe; None where they are too few."""
        known = [value for value in self.readings(values).values() if value is not None]
        return round(sum(known) / len(known), 4) if len(known) >= self.at_least else None


class PowerSupply(Strict):
    """The battery's gauge; ``charging_is`` is the sign of a charging current here, which is positive in a trace."""

    name: Name
    columns: Annotated[dict[Literal["temp", "current_now", "voltage_now"], _Column], Field(min_length=1)]
    charging_is: Literal["positive", "negative"] = "positive"

    @field_validator("columns")
    @classmethod
    def _in_their_units(cls, columns: dict[str, str]) -> dict[str, str]:
        return {attribute: _column(column, _SUPPLY_UNITS[attribute]) for attribute, column in columns.items()}


class DeviceConfig(Strict):
    """The device under test: ``zones`` maps a thermal zone's type to a column, ``root`` stands before ``/sys``.

    ``connect`` is ``adb``, ``adb SERIAL``, ``ssh HOST``, or ``local`` for this machine; ``setup`` is shell text for
    every connection, such as functions that actions use, and starts nothing.
    """

    connect: Annotated[str, Field(pattern=r"^(adb|adb [A-Za-z0-9_.:-]+|ssh [A-Za-z0-9_][A-Za-z0-9_.@:-]*|local)$")]
    root: Annotated[str, Field(pattern=r"^(/[A-Za-z0-9_./-]*)?$")] = ""
    period_s: PositiveFloat = 1.0
    timeout_s: PositiveFloat = 5.0
    zones: Annotated[dict[str, _TemperatureColumn], Field(min_length=1)]
    power_supply: PowerSupply | None = None
    setup: Annotated[str, Field(max_length=32768)] = ""

    @property
    def columns(self) -> tuple[str, ...]:
        """The trace's columns that the device fills."""
        return (*self.zones.values(), *(self.power_supply.columns.values() if self.power_supply else ()))


class Action(Strict):
    """A load of the device, by shell commands that may be run in either state, and its values of signal columns."""

    start: str
    stop: str
    signals: dict[str, _Signal]


class Safety(Strict):
    """Where the chamber goes at the end of a run or when something is wrong, and what is wrong.

    ``device_high_degC`` is by column; ``ambient_lost_s`` the longest time without an ambient while the chamber works.
    With a set point that the chamber does not confirm within ``confirm_s``, the run goes on, waits, or ends, as
    ``unconfirmed`` says; it counts as incomplete in any case. ``set_point_degC`` and ``chamber`` are a chamber's.
    """

    set_point_degC: _Temperature | None = None
    chamber: ChamberLimits | None = None
    device_high_degC: dict[str, _Temperature] = Field(default_factory=dict)
    ambient_lost_s: PositiveFloat = 120.0
    confirm_s: PositiveFloat = 120.0
    unconfirmed: Literal["go-on", "wait", "end"] = "go-on"


class Laboratory(Strict):
    """Instruments, a device, its loads, the signal columns with their values while no action lasts, and limits."""

    instruments: Instruments
    ambient: Ambient
    device: DeviceConfig
    signals: dict[_Column, _Signal] = Field(default_factory=dict)
    actions: dict[Name, Action] = Field(default_factory=dict)
    safety: Safety

    def _wrong(self) -> Iterator[tuple[str, str]]:
        chamber, limits = self.instruments.chamber, self.safety.chamber
        if not isinstance(chamber, ChamberSettings) or limits is None:
            return
        if not chamber.lowest_degC <= limits.low_degC < limits.high_degC <= chamber.highest_degC:
            within = f"{chamber.lowest_degC:g} to {chamber.highest_degC:g} degC"
            problem = f"the limits {limits.low_degC:g} to {limits.high_degC:g} degC are not the chamber's"
            yield problem, f"stay within {within}, or give its 'lowest_degC' and 'highest_degC'"

    @property
    def reference(self) -> str:
        """The instrument that the ambient comes from."""
        return MULTIPLEXER if self.instruments.multiplexer else THERMOMETER


class Campaign(Scenario):
    """A laboratory and its program; the trace begins after the steps of ``before``, which are logged beside it."""

    format: Literal["ambient-campaign"]
    version: Literal[1]
    laboratory: Laboratory

    @property
    def columns(self) -> tuple[str, ...]:
        """The trace's, without ``time_s``."""
        return (*self.laboratory.device.columns, REFERENCE, *self.laboratory.signals)

    @property
    def no_gradient_K_min(self) -> float | None:
        """What lifts a gradient; None where no step has one, so that the chamber's own gradients stay as they are."""
        return 0.0 if any(step.gradient_K_min is not None for step in self.program) else None

    def step_name(self, index: int) -> str:
        """A step of the program for a table: its number, from 1 on, in ``before`` or in the recording."""
        count = len(self.before)
        return f"before {index + 1}" if index < count else str(index - count + 1)


class LoadedCampaign(NamedTuple):
    """A campaign as it stands in its ``files``, its own first; ``sha256`` is of all of them."""

    name: str
    path: str
    campaign: Campaign
    offsets: Mapping[str, ProbeOffset]
    sha256: str
    files: tuple[str, ...]


def load_campaign(path: str, ports: bool = True) -> LoadedCampaign:
    """The campaign of a file; raises :class:`Refused` with every fault, with ``ports`` also where one is not there."""
    data = load_yaml(path)
    if not isinstance(data, dict):
        raise refuse(path, "", "holds no campaign", "start from one that is shipped: see the README")
    files = [path]
    folder = os.path.dirname(path)
    if isinstance(data.get("laboratory"), str):
        files.append(os.path.join(folder, data["laboratory"]))
        data = {**data, "laboratory": load_yaml(files[-1])}
    offsets: Mapping[str, ProbeOffset] = {}
    model, faults = _model_for(data)
    if isinstance(named := _at(data, "laboratory.ambient.offsets"), str):
        files.append(os.path.join(folder, named))
        try:
            offsets = load_offsets(files[-1])
        except Refused as refused:
            faults += [fault._replace(place=f"laboratory.ambient.offsets {fault.place}") for fault in refused.faults]
    campaign = validated(model, data, path, [*faults, *faults_between(data, ports, offsets)])
    name = os.path.basename(path).removesuffix(".yaml").removesuffix(".yml")
    digests = (hashlib.sha256(Path(each).read_bytes()).digest() for each in files)
    return LoadedCampaign(name, path, campaign, offsets, hashlib.sha256(b"".join(digests)).hexdigest(), tuple(files))


def _model_for(data: Any) -> tuple[type[Campaign], list[Fault]]:
    """The campaign whose instruments have the settings of their kinds, and a fault for each kind that is unknown."""
    settings: dict[str, Any] = {}
    faults = []
    for role in kinds.ROLES:
        kind, known = _at(data, f"laboratory.instruments.{role}.kind"), kinds.settings_by_kind(role)
        if isinstance(kind, str):
            settings[role] = (known.get(kind, Any), ...)
            if kind not in known:
                place, hint = f"laboratory.instruments.{role}.kind", f"known are {', '.join(known)}"
                faults.append(Fault(place, f"no {role} is of kind {kind!r}", hint))
    instruments = create_model("Instruments", __base__=Instruments, **settings)
    laboratory = create_model("Laboratory", __base__=Laboratory, instruments=(instruments, ...))
    return create_model("Campaign", __base__=Campaign, laboratory=(laboratory, ...)), faults


def faults_between(data: Any, ports: bool, offsets: Iterable[str] = ()) -> Iterator[Fault]:
    """Faults between parts of a campaign's ``data``, of any form; ``ports``: also where a port is not there."""
    laboratory = _at(data, "laboratory", dict)
    instruments, safety = _at(laboratory, "instruments", dict), _at(laboratory, "safety", dict)
    probes = _at(instruments, f"{MULTIPLEXER}.probes", dict) if instruments.get(MULTIPLEXER) else {THERMOMETER: None}
    actions, signals = _at(laboratory, "actions", dict), _at(laboratory, "signals", dict)
    yield from _port_faults(instruments, ports)
    if instruments and not any(instruments.get(role) for role in (MULTIPLEXER, THERMOMETER)):
        yield Fault("laboratory.instruments", "nothing measures the ambient", "add a multiplexer or a thermometer")
    if probes:
        yield from _unknown("laboratory.ambient.probes", _at(laboratory, "ambient.probes", list), probes, "probe")
    calibrated = () if THERMOMETER in probes else probes
    for each in _unknown("", offsets, calibrated, "probe"):
        yield each._replace(place="laboratory.ambient.offsets")
    yield from _column_faults(laboratory)
    for name, action in actions.items():
        yield from _unknown(f"laboratory.actions.{name}.signals", _at(action, "signals", dict), signals, "signal")
    set_points = {f"laboratory.safety.{key}": safety.get(key) for key in ("set_point_degC", "chamber")}
    for part in ("before", "steps"):
        for index, step in enumerate(_at(data, part, list)):
            set_points[f"{part}[{index}].chamber_degC"] = _at(step, "chamber_degC")
            yield from _unknown(f"{part}[{index}].load", _at(step, "load", list), actions, "action")
    if instruments:
        yield from _set_point_faults(set_points, instruments.get(CHAMBER) is not None, safety)


def _unknown(place: str, names: Iterable[Any], known: Iterable[Any], what: str) -> Iterator[Fault]:
    for index, name in enumerate(names):
        if name not in known:
            there = f"{place}.{name}" if isinstance(names, dict) else f"{place}[{index}]"
            yield Fault(there, f"no {what} is called {name!r}", f"known are {', '.join(map(str, known)) or 'none'}")


def _port_faults(instruments: dict[Any, Any], ports: bool) -> Iterator[Fault]:
    owners: dict[str, str] = {}
    for name, settings in instruments.items():
        port, place = _at(settings, "port"), f"laboratory.instruments.{name}.port"
        if not isinstance(port, str):
            continue
        owner = owners.setdefault(os.path.realpath(port), str(name))
        if owner != name:
            yield Fault(place, f"{port} is the {owner}'s, too", "each instrument has a port of its own")
        if ports and is_missing(port):
            yield Fault(place, f"{port} is not there", "plug the adapter in, or name its port (see /dev/serial/by-id)")


def _column_faults(laboratory: dict[Any, Any]) -> Iterator[Fault]:
    zones = _at(laboratory, "device.zones", dict)
    supply = _at(laboratory, "device.power_supply.columns", dict)
    places = {f"laboratory.device.zones.{zone}": column for zone, column in zones.items()}
    places |= {f"laboratory.device.power_supply.columns.{name}": column for name, column in supply.items()}
    places |= {f"laboratory.signals.{column}": column for column in _at(laboratory, "signals", dict)}
    owners = {REFERENCE: "the reference", "time_s": "the time"}
    for place, column in places.items():
        if isinstance(column, str) and (owner := owners.setdefault(column, place)) != place:
            yield Fault(place, f"{column!r} is {owner}, too", "give each column a name of its own")
    known = [column for column in [*zones.values(), *supply.values()] if str(column).endswith("_degC")]
    limits = _at(laboratory, "safety.device_high_degC", dict)
    yield from _unknown("laboratory.safety.device_high_degC", limits, known, "temperature")


def _set_point_faults(values: Mapping[str, Any], chamber: bool, safety: dict[Any, Any]) -> Iterator[Fault]:
    """What a chamber needs and is not there, the same without a chamber, and set points outside its limits."""
    low, high = (_at(safety, f"chamber.{key}") for key in ("low_degC", "high_degC"))
    low, high = (limit if type(limit) in (int, float) else None for limit in (low, high))
    for place, value in values.items():
        if value is None and chamber:
            yield Fault(place, "missing", "add it: there is a chamber")
        elif value is not None and not chamber:
            yield Fault(place, "there is no chamber", "remove it, or add 'laboratory.instruments.chamber'")
        elif type(value) in (int, float) and ((low is not None and value < low) or (high is not None and value > high)):
            within = f"{'?' if low is None else f'{low:g}'} to {'?' if high is None else f'{high:g}'} degC"
            yield Fault(place, f"{value:g} degC is outside the chamber's limits", f"stay within {within}")


def _at(data: Any, path: str, kind: type = object) -> Any:
    """What stands at the dotted ``path``; where that is not of a ``kind``, an empty one."""
    for key in path.split("."):
        data = data.get(key) if isinstance(data, dict) else None
    return data if isinstance(data, kind) else kind()
