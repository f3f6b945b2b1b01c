"""Instruments: each module here is one, known by the ``kind`` in a campaign, with driver, protocol and simulated side.

A module ``my_meter.py`` is the kind ``my-meter``; an installed package adds one by an entry point of the group
``ambient_trainer.laboratory.instruments``. It holds three classes:

``Settings``
    Its part of a campaign: a subclass of the settings of its role, one of :data:`ROLES`.
``Driver``
    Made of (settings, clock); a chamber's also of its set point's limits, a multiplexer's of the probes' offsets. It is
    a :class:`Driver`, a chamber's a :class:`ChamberDriver`.
``Simulated``
    The instrument for ``--simulate``, with a ``port`` and ``close()``, made of (settings, clock, seed of the air,
    temperature at the start) for a chamber, which has ``air_degC(at_s)``, of (settings, clock, air, seed, errors_K by
    probe or None) for a multiplexer and of (settings, clock, air) for a thermometer. On a serial line it is a
    :class:`~ambient_trainer.laboratory.pseudo_terminal.SimulatedInstrument`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from types import ModuleType
from typing import Annotated, Any, Protocol

from pydantic import Field, NonNegativeFloat, PositiveFloat, field_validator

from ambient_model.faults import refuse
from ambient_trainer.data.plugins import plugin, plugin_names
from ambient_trainer.data.probe_offsets import ProbeOffset
from ambient_trainer.data.strict_yaml import Strict, validated, wrong
from ambient_trainer.laboratory.messages import Reading

Air = Callable[[float], float]
"""The temperature in degC at a time of the clock."""
Name = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_.-]*$")]
STEEPEST_K_MIN = 99.9


class ChamberLimits(Strict):
    """The limits of set points; the chamber's air may leave them by no more than ``margin_K``."""

    low_degC: float
    high_degC: float
    margin_K: NonNegativeFloat = 3.0

    def _wrong(self) -> Iterator[tuple[str, str]]:
        if not self.low_degC < self.high_degC:
            yield f"{self.low_degC:g} to {self.high_degC:g} degC holds nothing", "low lies below high"

    def set_point(self, temp_degC: float) -> float:
        """``temp_degC`` in tenths; raises :class:`Refused` outside the limits."""
        rounded_degC = round(temp_degC, 1) + 0.0  # no -0.0
        if not self.low_degC <= min(temp_degC, rounded_degC) <= max(temp_degC, rounded_degC) <= self.high_degC:
            problem = f"{temp_degC:g} degC is outside its limits, {self.low_degC:g} to {self.high_degC:g} degC"
            raise refuse("chamber", "set point", problem, "choose another, or other limits; nothing was sent")
        return rounded_degC

    def gradient(self, rate_K_min: float) -> float:
        """``rate_K_min`` in tenths, 0 for none; raises :class:`Refused` for what a chamber does not take."""
        rounded_K_min = round(rate_K_min, 1) if 0.0 <= rate_K_min <= STEEPEST_K_MIN else 0.0
        if rounded_K_min == 0.0 and rate_K_min != 0.0:
            hint = f"choose 0.1 to {STEEPEST_K_MIN:g} K/min, or 0 for none; nothing was sent"
            raise refuse("chamber", "gradient", f"{rate_K_min:g} K/min", hint)
        return rounded_K_min


class ChamberSettings(Strict):
    """A climate chamber, with the usual rates of its air, for the schedule, and the temperatures that it can do."""

    kind: str
    port: str
    period_s: PositiveFloat = 10.0
    timeout_s: PositiveFloat = 2.0
    heating_K_min: PositiveFloat = 2.0
    cooling_K_min: PositiveFloat = 1.5
    lowest_degC: float = -100.0
    highest_degC: float = 250.0


class MultiplexerSettings(Strict):
    """A multiplexer, or whatever else has several probes; ``probes`` maps a name to its channel."""

    kind: str
    port: str
    period_s: PositiveFloat = 1.0
    timeout_s: PositiveFloat = 5.0
    probes: Annotated[dict[Name, Any], Field(min_length=1)]

    @field_validator("probes")
    @classmethod
    def _one_channel_each(cls, probes: dict[str, Any]) -> dict[str, Any]:
        owners: dict[Any, str] = {}
        for name, probe in probes.items():
            channel, hint = getattr(probe, "channel", probe), "give each probe a channel of its own"
            if (owner := owners.setdefault(channel, name)) != name:
                raise wrong(f"channel {channel} is named for {owner} and {name}", hint)
        return probes


class ThermometerSettings(Strict):
    """A reference thermometer, read every ``period_s``."""

    kind: str
    port: str
    period_s: PositiveFloat = 10.0
    timeout_s: PositiveFloat = 1.0


class Driver(Protocol):
    """An instrument at its port, which is opened by the first query and again after it was lost.

    Every method raises :class:`~ambient_trainer.laboratory.messages.InstrumentError`; after any, it may be asked again.
    Several threads may ask, one exchange at a time.
    """

    def identify(self) -> str:
        """The instrument's own identification."""

    def read(self) -> Reading:
        """One reading of all columns."""

    def close(self) -> None:
        """Give the port back."""


class ChamberDriver(Driver, Protocol):
    """A chamber; its reading has :data:`SET_POINT`, :data:`AIR` and :data:`RUNNING`, and an alarm as its note."""

    def set_point(self, temp_degC: float) -> None:
        """Go to ``temp_degC`` and start, without waiting; raises :class:`Refused` outside the limits."""

    def gradient(self, rate_K_min: float, rising: bool = True) -> None:
        """Let the set point move no faster than this on its way up, or down; 0 does not limit it."""

    def stop(self) -> None:
        """Stop heating and cooling."""


SET_POINT, AIR, RUNNING = "chamber_set_degC", "chamber_degC", "chamber_on"
"""Columns of a chamber's reading."""
THERMOMETER_COLUMN = "thermometer_degC"
DIGITS = 7
"""To which a temperature that comes in another unit is rounded in degC."""


def plausible(temp_degC: float) -> bool:
    """Whether what a kernel shows is a reading: -274000 or -32768000 stand for none."""
    return -60.0 <= temp_degC <= 250.0


def probe_column(name: str) -> str:
    """The column of the probe of that name."""
    return f"probe_{name}_degC"


def probe_values(
    readings: Mapping[str, float | None], offsets: Mapping[str, ProbeOffset] | None
) -> dict[str, float | None]:
    """By column what probes read, the offsets added to those that have one."""
    known = offsets or {}
    return {
        probe_column(name): value + known[name].at(value) if value is not None and name in known else value
        for name, value in readings.items()
    }


ROLES = {"chamber": ChamberSettings, "multiplexer": MultiplexerSettings, "thermometer": ThermometerSettings}
"""What an instrument can be in a campaign, and what the settings of every kind of it have."""


def settings_by_kind(role: str) -> dict[str, type[Strict]]:
    """The kinds of a role, one of :data:`ROLES`, and their settings."""
    settings = {kind: instrument(kind).Settings for kind in plugin_names(__name__)}
    return {kind: each for kind, each in settings.items() if issubclass(each, ROLES[role])}


def instrument(kind: str) -> ModuleType:
    """The module of the instrument of that kind; raises ``KeyError`` where there is none."""
    return plugin(__name__, kind)


def settings(kind: str, **values: object) -> Any:
    """The settings of an instrument of that kind; raises :class:`Refused` with every fault in ``values``."""
    return validated(instrument(kind).Settings, {"kind": kind, **values}, kind)
