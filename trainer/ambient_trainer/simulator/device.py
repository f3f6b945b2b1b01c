"""A device is data: one YAML file in ``devices`` or the user's own, taken whole or refused; what its zones report.

No code knows a node's or an activity's name. A number in the file is plain, or a calibrated one with its bounds.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, NonNegativeFloat, PositiveFloat

from ambient_model.faults import Fault, Refused, refuse
from ambient_trainer.data.strict_yaml import Strict, load_yaml, shipped_path, validated
from ambient_trainer.data.trace import Array
from ambient_trainer.lti.lag import lagged
from ambient_trainer.simulator.chamber import Chamber

Values = Mapping[str, float]

_Share = Annotated[float, Field(ge=0, le=1)]


class Node(Strict):
    """A part with one temperature; without a surface it loses heat to its neighbours only."""

    capacitance_J_K: PositiveFloat
    surface_m2: NonNegativeFloat = 0.0
    emissivity: _Share = 0.9


class Governor(Strict):
    """Cuts the power of a hot node: all of it below ``low_degC``, the floor's share above ``high_degC``."""

    low_degC: float
    high_degC: float
    floor_frac: _Share


class Processor(Strict):
    """The node whose power is logged, and cut by a governor."""

    node: str
    logs: str
    governor: Governor | None = None


class Bursts(Strict):
    """A swing of the processor's power while an activity lasts: standard deviation over the mean, and period."""

    frac: NonNegativeFloat
    period_s: PositiveFloat


class Activity(Strict):
    """Heat by node, the charger's current, and what is logged; what it does not name is as in the first activity."""

    heat_W: dict[str, NonNegativeFloat] = Field(default_factory=dict)
    charging_A: NonNegativeFloat = 0.0
    bursts: Bursts | None = None
    logs: dict[str, float] = Field(default_factory=dict)


class Battery(Strict):
    """A cell that all power comes from; its resistance grows in the cold (Arrhenius)."""

    node: str
    logs: str
    volt_V: PositiveFloat
    ohm: PositiveFloat
    activation_K: float
    reference_degC: float


class Fan(Strict):
    """Its speed follows a node from ``least_frac`` to 1; at 1 it carries ``vents_W_K`` from nodes to the air."""

    follows: str
    logs: str
    low_degC: float
    high_degC: float
    least_frac: _Share
    vents_W_K: dict[str, NonNegativeFloat]


class Zone(Strict):
    """A thermal zone: ``near`` is the node that its sensor feels; ``share`` of ``beside`` is mixed in."""

    name: str
    near: str
    beside: str | None = None
    share: _Share = 0.0
    sensor: Literal["silicon", "thermistor"]
    """Which tolerances of manufacture it has."""
    lag_s: PositiveFloat
    offset_degC: float = 0.0
    noise_degC: NonNegativeFloat
    step_degC: PositiveFloat
    """What the reading is rounded to."""

    def reported(self, felt_degC: Array, noise: Array) -> Array:
        """What it reports with ``noise`` of unit variance, of the same shape."""
        noisy = felt_degC + self.offset_degC + self.noise_degC * noise
        return np.round(np.round(noisy / self.step_degC) * self.step_degC, 6)


class SensorTolerance(Strict):
    """Error of offset (the sum of several) and of gain, as standard deviations or as bounds."""

    drawn: Literal["normal", "uniform"]
    offset_K: tuple[NonNegativeFloat, ...]
    gain: NonNegativeFloat


class Tolerances(Strict):
    """How units of one make differ: the standard deviation of a log-normal factor each, but for sensors' errors."""

    capacitance: NonNegativeFloat
    conductance: NonNegativeFloat
    loss: NonNegativeFloat
    idle_power: NonNegativeFloat
    load_power: NonNegativeFloat
    battery_ohm: NonNegativeFloat = 0.0
    lag: NonNegativeFloat
    share: NonNegativeFloat
    sensors: dict[str, SensorTolerance]


class HiddenPlace(Strict):
    """Where a hidden effect is drawn (None: everywhere), its typical size there, and what may drive it."""

    at: str | None = None
    size: PositiveFloat | None = None
    signals: tuple[str | None, ...] = (None,)


class Device(Strict):
    """A device and the climate chamber that it is simulated in.

    Mappings keep the file's order: of nodes in arrays of shape (..., nodes), of activities as indices.
    """

    about: str
    nodes: Annotated[dict[str, Node], Field(min_length=1)]
    conductance_W_K: dict[str, NonNegativeFloat]
    """By ``a-b`` of two nodes."""
    convection_W_m2_K125: NonNegativeFloat
    """h = this x dT^0.25."""
    sides: dict[str, tuple[str, ...]] = Field(default_factory=dict)
    """Surfaces that are covered or touched together, by the name of one of them."""
    processor: Processor
    activities: Annotated[dict[str, Activity], Field(min_length=1)]
    battery: Battery | None = None
    fan: Fan | None = None
    sensors: Annotated[tuple[str, ...], Field(min_length=1)]
    """Zones that are logged where not all are asked for."""
    zones: Annotated[tuple[Zone, ...], Field(min_length=1)]
    tolerances: Tolerances | None = None
    hidden: dict[str, tuple[HiddenPlace, ...]] = Field(default_factory=dict)
    """By cause, where a drawn effect is hidden."""
    chamber: Chamber

    @property
    def idle(self) -> str:
        """The activity of a device that nothing is asked of: the first one."""
        return next(iter(self.activities))

    @property
    def surfaces(self) -> tuple[str, ...]:
        """Nodes that lose heat to air and walls."""
        return tuple(name for name, node in self.nodes.items() if node.surface_m2)

    @property
    def main_zones(self) -> tuple[Zone, ...]:
        """The zones of ``sensors``, in its order."""
        return tuple(self.zone(name) for name in self.sensors)

    def zone(self, name: str) -> Zone:
        """The zone of that name."""
        return next(zone for zone in self.zones if zone.name == name)

    def index(self, node: str) -> int:
        """The place of a node in arrays."""
        return list(self.nodes).index(node)

    def pattern(self, values: Values) -> Array:
        """``values`` by node as an array, shape (nodes,), zero where there is none."""
        return np.array([values.get(node, 0.0) for node in self.nodes])

    def felt_weights(self, zone: Zone) -> Array:
        """How much of every node a zone's sensor feels, shape (nodes,); they sum to one."""
        return self.pattern({zone.near: 1.0 - zone.share, **({zone.beside: zone.share} if zone.beside else {})})

    def felt(self, zone: Zone, nodes_degC: Array, period_s: float) -> Array:
        """The temperature of a zone's sensor, shape (n,), from the nodes', shape (n, nodes)."""
        return lagged(nodes_degC @ self.felt_weights(zone), zone.lag_s, period_s)

    def activity_index(self, load: Sequence[str]) -> int:
        """The index of what a step asks for: its one load, or idle; raises :class:`Refused` for an unknown one."""
        name = load[0] if load else self.idle
        if name not in self.activities:
            raise refuse("scenario", "load", f"the device does not know {name!r}", f"take {', '.join(self.activities)}")
        return list(self.activities).index(name)

    def covered(self, location: str | None) -> tuple[str, ...]:
        """The surfaces that something on the outside touches: all, a side's, or one."""
        return self.surfaces if location is None else self.sides.get(location, (location,))

    def sensor_of(self, node: str) -> str | None:
        """The logged zone that feels most of a node; None where none feels half of it."""
        for zone in self.main_zones:
            if zone.near == node or (zone.beside == node and zone.share >= 0.5):
                return zone.name
        return None

    def with_values(self, values: Values) -> Device:
        """The device with some numbers changed, by path: ``nodes.usb.capacitance_J_K``, ``zones.usb.share``."""
        data = self.model_dump()
        for path, value in values.items():
            *owners, key = path.split(".")
            part = data
            for owner in owners:
                part = part[owner] if isinstance(part, dict) else next(each for each in part if each["name"] == owner)
            part[key] = value
        return Device.model_validate(data)

    def names(self) -> Iterator[tuple[str, Sequence[str], Sequence[str]]]:
        """(place, names that are used there, names that there are)."""
        nodes, zones = tuple(self.nodes), tuple(zone.name for zone in self.zones)
        for edge in self.conductance_W_K:
            yield f"conductance_W_K.{edge}", edge.split("-"), nodes
        for zone in self.zones:
            yield f"zones.{zone.name}", [zone.near, *([zone.beside] if zone.beside else [])], nodes
        for name, activity in self.activities.items():
            yield f"activities.{name}.heat_W", list(activity.heat_W), nodes
            yield f"activities.{name}.logs", list(activity.logs), list(self.activities[self.idle].logs)
        for side, covered in self.sides.items():
            yield f"sides.{side}", [side, *covered], self.surfaces
        yield "processor.node", [self.processor.node], nodes
        yield "sensors", self.sensors, zones
        if self.battery:
            yield "battery.node", [self.battery.node], nodes
        if self.fan:
            yield "fan", [self.fan.follows, *self.fan.vents_W_K], nodes
        if self.tolerances:
            yield "zones", [zone.sensor for zone in self.zones], list(self.tolerances.sensors)


FOLDER = Path(__file__).with_name("devices")
DEFAULT = "phone"


class Constant(Strict):
    """A calibrated number in the place of a plain one; ``start`` is the guess that a calibration begins with."""

    value: PositiveFloat
    start: PositiveFloat
    low: PositiveFloat
    high: PositiveFloat

    def _wrong(self) -> Iterator[tuple[str, str]]:
        if not (self.low <= self.start <= self.high and self.low <= self.value <= self.high):
            yield "start or value lies outside low to high", "widen the bounds or move it"


def device_names() -> tuple[str, ...]:
    """The names of the shipped devices."""
    return tuple(sorted(path.stem for path in FOLDER.glob("*.yaml")))


def device_path(name: str) -> str:
    """The file of the shipped device of that name, or ``name`` itself where it is a file's; else ``Refused``."""
    return shipped_path("device", name, FOLDER, device_names())


def load_device(name: str = DEFAULT) -> Device:
    """The shipped device of that name, or the one in a YAML file; raises :class:`Refused` with every fault in it."""
    return _shipped(name) if name in device_names() else _loaded(name)


def load_constants(name: str = DEFAULT) -> dict[str, Constant]:
    """The calibrated numbers of a device by path; raises :class:`Refused`."""
    return _read(name)[1]


def with_calibrated(text: str, values: Values) -> str:
    """The text of a device file with new ``values`` of its calibrated numbers, in their order, all else as it is."""
    left = iter(values.values())
    return re.sub(r"(?<=\{value: )[^,}]+", lambda _: f"{rounded(next(left)):g}", text)


def rounded(value: float) -> float:
    """``value`` to the digits that a device file holds of a calibrated number."""
    return float(f"{value:.4g}")


def _loaded(name: str) -> Device:
    data, _ = _read(name)
    device = validated(Device, data, name)
    faults = [
        Fault(place, f"there is no {used!r}", f"take one of {', '.join(known)}")
        for place, names, known in device.names()
        for used in names
        if used not in known
    ]
    if faults:
        raise Refused(name, faults)
    return device


_shipped = cache(_loaded)


class _Constants(Strict):
    constants: dict[str, Constant]


def _read(name: str) -> tuple[Any, dict[str, Constant]]:
    """A device file with plain numbers, and the calibrated ones by path."""
    found: dict[str, Any] = {}

    def plain(part: Any, path: str) -> Any:
        if isinstance(part, list):
            names = [each.get("name", index) if isinstance(each, dict) else index for index, each in enumerate(part)]
            return [plain(each, f"{path}.{key}") for key, each in zip(names, part)]
        if isinstance(part, dict) and "value" in part:
            found[path.lstrip(".")], part = part, part["value"]
        return {key: plain(each, f"{path}.{key}") for key, each in part.items()} if isinstance(part, dict) else part

    data = plain(load_yaml(device_path(name)), "")
    return data, validated(_Constants, {"constants": found}, name).constants
