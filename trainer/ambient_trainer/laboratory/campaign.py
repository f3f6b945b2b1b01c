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

from pydantic import AfterValidator, Field, create_model, field_validator, model_validator

from ambient_model.faults import Fault, Refused, refuse
from ambient_model.trace import REFERENCE, split_column
from ambient_trainer.data.strict_yaml import Strict, load_yaml, validated, wrong
from ambient_trainer.laboratory.instruments import (
    ROLES,
    ChamberLimits,
    ChamberSettings,
    MultiplexerSettings,
    Name,
    Positive,
    ThermometerSettings,
    probe_column,
    settings_by_kind,
)
from ambient_trainer.laboratory.messages import CHAMBER, MULTIPLEXER, THERMOMETER
from ambient_trainer.laboratory.probe_offsets import ProbeOffset, load_offsets
from ambient_trainer.laboratory.serial_line import is_missing
from ambient_trainer.simulator.scenario import Scenario, Settle

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
    multiplexer: MultiplexerSettings | None = None
    thermometer: ThermometerSettings | None = None

    @property
    def named(self) -> dict[str, Any]:
        """The settings of those that are there, by role."""
        return {role: settings for role, settings in self if settings is not None}


class Ambient(Strict):
    """The ambient is the mean of several probes in the chamber's middle, as in the thesis.

    With fewer than ``at_least`` that answer it is missing; ``offsets`` is the file that ``calibrate`` wrote. Without a
    multiplexer, ``probes`` is ``[thermometer]``.
    """

    probes: Annotated[tuple[Name, ...], Field(min_length=1)]
    at_least: Annotated[int, Field(ge=1)] = 1
    offsets: str | None = None

    @model_validator(mode="after")
    def _possible(self) -> Ambient:
        if twice := [name for index, name in enumerate(self.probes) if name in self.probes[:index]]:
            raise wrong(f"{twice[0]!r} stands twice", "name each probe once")
        if self.at_least > len(self.probes):
            problem = f"'at_least' asks for {self.at_least} of {len(self.probes)} probes"
            raise wrong(problem, "ask for as many as there are, or fewer")
        return self

    def readings(self, values: Mapping[str, float | None]) -> dict[str, float | None]:
        """What each probe reads; a thermometer alone has a column of its own."""
        return {name: values.get(probe_column(name), values.get(f"{name}_degC")) for name in self.probes}

    def mean_degC(self, values: Mapping[str, float | None]) -> float | None:
        """The mean of the probes that answered, to the digits of a probe; None where they are too few."""
        known = [value for value in self.readings(values).values() if value is not None]
        return round(sum(known) / len(known), 4) if len(known) >= self.at_least else None


class PowerSupply(Strict):
    """The battery's gauge: attribute to column.

    ``charging_is`` is this vendor's sign of a charging current; a trace's is positive into the battery.
    """

    name: Name
    columns: Annotated[dict[Literal["temp", "current_now", "voltage_now"], _Column], Field(min_length=1)]
    charging_is: Literal["positive", "negative"] = "positive"

    @field_validator("columns")
    @classmethod
    def _in_their_units(cls, columns: dict[str, str]) -> dict[str, str]:
        return {attribute: _column(column, _SUPPLY_UNITS[attribute]) for attribute, column in columns.items()}


class Device(Strict):
    """The device under test: ``zones`` maps a thermal zone's type to a column, ``root`` stands before ``/sys``.

    ``connect`` is ``adb``, ``adb SERIAL``, ``ssh HOST``, or ``local`` for this machine; ``setup`` is shell text for
    every connection, such as functions that actions use, and starts nothing.
    """

    connect: Annotated[str, Field(pattern=r"^(adb|adb [A-Za-z0-9_.:-]+|ssh [A-Za-z0-9_][A-Za-z0-9_.@:-]*|local)$")]
    root: Annotated[str, Field(pattern=r"^(/[A-Za-z0-9_./-]*)?$")] = ""
    period_s: Positive = 1.0
    timeout_s: Positive = 5.0
    zones: Annotated[dict[str, _TemperatureColumn], Field(min_length=1)]
    power_supply: PowerSupply | None = None
    setup: str = ""

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
    ambient_lost_s: Positive = 120.0
    confirm_s: Positive = 120.0
    unconfirmed: Literal["go-on", "wait", "end"] = "go-on"


class Laboratory(Strict):
    """Instruments, a device, its loads, the signal columns with their values while no action lasts, and limits."""

    instruments: Instruments
    ambient: Ambient
    device: Device
    signals: dict[_Column, _Signal] = Field(default_factory=dict)
    actions: dict[Name, Action] = Field(default_factory=dict)
    safety: Safety

    @model_validator(mode="after")
    def _within_the_chamber(self) -> Laboratory:
        chamber, limits = self.instruments.chamber, self.safety.chamber
        if not isinstance(chamber, ChamberSettings) or limits is None:
            return self
        if not chamber.lowest_degC <= limits.low_degC < limits.high_degC <= chamber.highest_degC:
            within = f"{chamber.lowest_degC:g} to {chamber.highest_degC:g} degC"
            problem = f"the limits {limits.low_degC:g} to {limits.high_degC:g} degC are not the chamber's"
            raise wrong(problem, f"stay within {within}, or give its 'lowest_degC' and 'highest_degC'")
        return self

    @property
    def reference(self) -> str:
        """The instrument that the ambient comes from."""
        return MULTIPLEXER if self.instruments.multiplexer else THERMOMETER


class Campaign(Scenario):
    """A laboratory and the program that it runs through.

    The trace has a row each ``period_s``. It begins after the steps of ``before``, which are logged beside it.
    """

    format: Literal["ambient-campaign"]
    version: Literal[1]
    laboratory: Laboratory

    @property
    def columns(self) -> tuple[str, ...]:
        """The trace's, without ``time_s``."""
        return (*self.laboratory.device.columns, REFERENCE, *self.laboratory.signals)

    @property
    def gradients(self) -> bool:
        """Whether any step limits how fast the set point moves; else the chamber's own gradients stay as they are."""
        return any(step.gradient_K_min is not None for step in self.program)

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
    """The campaign in a file.

    Parameters
    ----------
    path : str
        A YAML file.
    ports : bool
        Whether a port that is not there is a fault.

    Returns
    -------
    LoadedCampaign
        The campaign, with the offsets of its probes.

    Raises
    ------
    Refused
        With every fault in it.
    """
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
    if isinstance(named := _at(data, "laboratory", "ambient", "offsets"), str):
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
    for role in ROLES:
        kind, known = _at(data, "laboratory", "instruments", role, "kind"), settings_by_kind(role)
        if isinstance(kind, str):
            settings[role] = (known.get(kind, Any), ...)
            if kind not in known:
                place, hint = f"laboratory.instruments.{role}.kind", f"known are {', '.join(known)}"
                faults.append(Fault(place, f"no {role} is of kind {kind!r}", hint))
    instruments = create_model("Instruments", __base__=Instruments, **settings)
    laboratory = create_model("Laboratory", __base__=Laboratory, instruments=(instruments, ...))
    return create_model("Campaign", __base__=Campaign, laboratory=(laboratory, ...)), faults


def _at(data: Any, *keys: str) -> Any:
    for key in keys:
        data = data.get(key) if isinstance(data, dict) else None
    return data


_DEFAULTS = {"at_most_min": Settle.model_fields["at_most_min"].default}


def faults_between(data: Any, ports: bool, offsets: Iterable[str] = ()) -> Iterator[Fault]:
    """Every such fault in the ``data`` of a campaign file; ``ports``: also where a port is not there."""
    laboratory = _mapping(data, "laboratory")
    yield from _port_faults(_mapping(laboratory, "instruments"), ports)
    yield from _probe_faults(laboratory, offsets)
    yield from _column_faults(laboratory)
    yield from _outside("laboratory.safety", "set_point_degC", _mapping(laboratory, "safety"), laboratory)
    yield from _missing_faults(data, laboratory)
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
        if ports and is_missing(port):
            yield Fault(place, f"{port} is not there", "plug the adapter in, or name its port (see /dev/serial/by-id)")


def _missing_faults(data: Any, laboratory: dict[Any, Any]) -> Iterator[Fault]:
    """What a chamber needs and is not there, and the same without a chamber."""
    instruments, safety = _at(laboratory, "instruments"), _at(laboratory, "safety")
    if not isinstance(instruments, dict):
        return
    places = [(f"laboratory.safety.{key}", safety) for key in ("set_point_degC", "chamber")]
    for part in ("before", "steps"):
        places += [(f"{part}[{index}].chamber_degC", step) for index, step in enumerate(_sequence(data, part))]
    chamber = instruments.get(CHAMBER) is not None
    for place, part in places:
        given = isinstance(part, dict) and part.get(place.rpartition(".")[2]) is not None
        if given and not chamber:
            yield Fault(place, "there is no chamber", "remove it, or add 'laboratory.instruments.chamber'")
        elif isinstance(part, dict) and chamber and not given:
            yield Fault(place, "missing", "add it: there is a chamber")
    if not any(instruments.get(role) for role in (MULTIPLEXER, THERMOMETER)):
        yield Fault("laboratory.instruments", "nothing measures the ambient", "add a multiplexer or a thermometer")


def _probe_faults(laboratory: dict[Any, Any], offsets: Iterable[str]) -> Iterator[Fault]:
    probes: Mapping[Any, Any] = _mapping(laboratory, "instruments", MULTIPLEXER, "probes")
    if _at(laboratory, "instruments", MULTIPLEXER) is None:
        probes = {THERMOMETER: None}
    for index, name in enumerate(_sequence(_mapping(laboratory, "ambient"), "probes")):
        if probes and str(name) not in map(str, probes):
            known = ", ".join(map(str, probes))
            place = f"laboratory.ambient.probes[{index}]"
            yield Fault(place, f"there is no probe {name!r}", f"name one of {known}")
    for name in offsets:
        if name not in probes or name == THERMOMETER:
            place = "laboratory.ambient.offsets"
            yield Fault(place, f"has an offset for {name!r}", "there is no such probe")


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
    inner = _at(data, *keys)
    return inner if isinstance(inner, dict) else {}


def _sequence(data: Any, key: str) -> list[Any]:
    inner = _at(data, key)
    return inner if isinstance(inner, list) else []


def _number(value: Any) -> float | None:
    return float(value) if isinstance(value, (int, float)) and not isinstance(value, bool) else None
