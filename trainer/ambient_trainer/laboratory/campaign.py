"""A campaign is data: a laboratory, and a program of steps that it runs through; refused whole, with every fault.

A laboratory is set up once and serves many programs: ``laboratory`` holds it, or names the file that does, beside the
campaign's own.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

from pydantic import Field

from ambient_model.faults import Refused, refuse
from ambient_model.trace import REFERENCE
from ambient_trainer.data.strict_yaml import Strict, load_yaml, validated
from ambient_trainer.laboratory.campaign_checks import faults_between, offset_faults
from ambient_trainer.laboratory.instruments.offsets import ProbeOffset, load_offsets
from ambient_trainer.simulator.scenario import Scenario

_Name = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_.-]*$")]
_Positive = Annotated[float, Field(gt=0)]
_NotNegative = Annotated[float, Field(ge=0)]
_Temperature = Annotated[float, Field(ge=-60, le=200)]
_Signal = Annotated[float, Field(ge=-1e6, le=1e6)]


class ChamberLink(Strict):
    """The climate chamber on its serial line."""

    kind: Literal["voetsch-vt4004"]
    port: str
    period_s: _Positive = 10.0
    """Of its readings; what the trace takes as ambient comes from the probes."""
    pause_s: _NotNegative = 0.0
    """Least time between two strings; a later controller needs 5 s."""
    timeout_s: _Positive = 2.0
    heating_K_min: _Positive = 2.0
    """How fast its air gets warmer, for the estimate of the schedule."""
    cooling_K_min: _Positive = 1.5


class MultiplexerLink(Strict):
    """The multiplexer with the probes."""

    kind: Literal["agilent-34970a"]
    port: str
    baud: Literal[57600, 115200] = 57600
    period_s: _Positive = 1.0
    timeout_s: _Positive = 5.0
    thermocouple: Literal["B", "E", "J", "K", "N", "R", "S", "T"] = "K"
    probes: Annotated[dict[_Name, Annotated[int, Field(ge=101, le=340)]], Field(min_length=1)]
    """Name to channel."""


class ThermometerLink(Strict):
    """The reference thermometer."""

    kind: Literal["greisinger-easybus"]
    port: str
    address: Annotated[int, Field(ge=0, le=255)] = 1
    period_s: _Positive = 10.0
    timeout_s: _Positive = 1.0


class Instruments(Strict):
    """What hangs on serial lines."""

    chamber: ChamberLink
    multiplexer: MultiplexerLink
    thermometer: ThermometerLink | None = None


class Ambient(Strict):
    """The ambient is the mean of several probes in the chamber's middle, as in the thesis."""

    probes: Annotated[tuple[_Name, ...], Field(min_length=1)]
    at_least: Annotated[int, Field(ge=1)] = 1
    """With fewer probes that answer, the ambient is missing."""
    offsets: str | None = None
    """The file that ``ambient-trainer calibrate`` wrote, beside the file that names it."""


class PowerSupply(Strict):
    """The battery's gauge: attribute to column."""

    name: _Name
    columns: Annotated[dict[Literal["temp", "current_now", "voltage_now"], str], Field(min_length=1)]
    charging_is: Literal["positive", "negative"] = "positive"
    """What this vendor means by a positive current; a trace's is positive into the battery."""


class Device(Strict):
    """The device under test."""

    connect: Annotated[str, Field(pattern=r"^(adb|adb [A-Za-z0-9_.:-]+|ssh [A-Za-z0-9_][A-Za-z0-9_.@:-]*|local)$")]
    """``adb``, ``adb SERIAL``, ``ssh HOST``, or ``local`` for this machine."""
    root: Annotated[str, Field(pattern=r"^(/[A-Za-z0-9_./-]*)?$")] = ""
    """What stands before ``/sys`` and ``/proc``."""
    period_s: _Positive = 1.0
    timeout_s: _Positive = 5.0
    zones: Annotated[dict[str, str], Field(min_length=1)]
    """A thermal zone's type to the trace's column."""
    power_supply: PowerSupply | None = None
    setup: str = ""
    """Shell text for every connection, such as functions that actions use; it starts nothing."""

    @property
    def columns(self) -> tuple[str, ...]:
        """The trace's columns that the device fills."""
        return (*self.zones.values(), *(self.power_supply.columns.values() if self.power_supply else ()))


class Action(Strict):
    """Something that the device is made to do, by shell commands; both may be run when it already is as they want."""

    start: str
    stop: str
    signals: dict[str, _Signal]
    """What the trace's signal columns say while it lasts."""


class ChamberLimits(Strict):
    """What set points may not leave, and its air by no more than a margin."""

    low_degC: Annotated[float, Field(ge=-45, le=185)]
    high_degC: Annotated[float, Field(ge=-45, le=185)]
    margin_K: _NotNegative = 3.0
    """How far the air may swing past the limits."""


class Safety(Strict):
    """Where the chamber goes when something is wrong, and what is."""

    set_point_degC: _Temperature
    """The safe set point: also where a run ends."""
    chamber: ChamberLimits
    device_high_degC: dict[str, _Temperature] = Field(default_factory=dict)
    """By column of the device."""
    ambient_lost_s: _Positive = 120.0
    """How long there may be no ambient while the chamber works."""


class Laboratory(Strict):
    """Instruments, a device, what it can be made to do, and what must not happen."""

    instruments: Instruments
    ambient: Ambient
    device: Device
    signals: dict[str, _Signal] = Field(default_factory=dict)
    """Signal columns, with what they say while no action lasts."""
    actions: dict[_Name, Action] = Field(default_factory=dict)
    safety: Safety


class Campaign(Scenario):
    """A laboratory and the program that it runs through."""

    format: Literal["ambient-campaign"]
    version: Literal[1]
    laboratory: Laboratory

    @property
    def columns(self) -> tuple[str, ...]:
        """The trace's, without ``time_s``."""
        return (*self.laboratory.device.columns, REFERENCE, *self.laboratory.signals)


class Loaded(NamedTuple):
    """A campaign as it stands in its files."""

    name: str
    path: str
    campaign: Campaign
    offsets: Mapping[str, ProbeOffset]
    sha256: str
    """Of the files that make it,"""
    files: tuple[str, ...]
    """its own first."""


def load_campaign(path: str, ports: bool = True) -> Loaded:
    """The campaign in the file at ``path``; raises :class:`Refused` with every fault in it.

    ``ports`` says whether a port that is not there is one of them.
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
    faults = list(faults_between(data, ports))
    if named := _offsets_file(data):
        files.append(os.path.join(folder, named))
        try:
            offsets = load_offsets(files[-1])
            faults += offset_faults(data, offsets)
        except Refused as refused:
            faults += [fault._replace(place=f"laboratory.ambient.offsets {fault.place}") for fault in refused.faults]
    campaign = validated(Campaign, data, path, faults)
    name = os.path.basename(path).removesuffix(".yaml").removesuffix(".yml")
    return Loaded(name, path, campaign, offsets, _digest(files), tuple(files))


def _offsets_file(data: Any) -> str | None:
    for key in ("laboratory", "ambient", "offsets"):
        data = data.get(key) if isinstance(data, dict) else None
    return data if isinstance(data, str) else None


def _digest(files: list[str]) -> str:
    """Of all the files, in order."""
    whole = hashlib.sha256()
    for path in files:
        whole.update(hashlib.sha256(Path(path).read_bytes()).digest())
    return whole.hexdigest()
