"""Device files: shipped or the user's own, taken whole or refused, with plain and with calibrated numbers."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, model_validator

from ambient_model.faults import Fault, Refused
from ambient_trainer.data.strict_yaml import Strict, load_yaml, shipped_path, validated, wrong
from ambient_trainer.simulator.device import Device, Values

FOLDER = Path(__file__).with_name("devices")
DEFAULT = "phone"

_Positive = Annotated[float, Field(gt=0)]


class Constant(Strict):
    """A calibrated number in the place of a plain one; ``start`` is the guess that a calibration begins with."""

    value: _Positive
    start: _Positive
    low: _Positive
    high: _Positive

    @model_validator(mode="after")
    def _inside(self) -> Constant:
        if not (self.low <= self.start <= self.high and self.low <= self.value <= self.high):
            raise wrong("start or value lies outside low to high", "widen the bounds or move it")
        return self


def device_names() -> tuple[str, ...]:
    """The names of the shipped devices."""
    return tuple(sorted(path.stem for path in FOLDER.glob("*.yaml")))


def device_path(name: str) -> str:
    """The file of the shipped device of that name, or ``name`` itself where it is a file's; else ``Refused``."""
    return shipped_path("device", name, FOLDER, device_names())


def load_device(name: str = DEFAULT) -> Device:
    """A simulated device.

    Parameters
    ----------
    name : str
        Name of a shipped device, or a YAML file.

    Returns
    -------
    Device
        Its nodes, activities, zones and tolerances, and the chamber that it is simulated in.

    Raises
    ------
    Refused
        With every fault in the file.
    """
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


@cache
def _shipped(name: str) -> Device:
    return _loaded(name)


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


class _Constants(Strict):
    constants: dict[str, Constant]


def _read(name: str) -> tuple[Any, dict[str, Constant]]:
    """A device file with plain numbers, and the calibrated ones by path."""
    found: dict[str, Any] = {}
    data = _plain(load_yaml(device_path(name)), "", found)
    return data, validated(_Constants, {"constants": found}, name).constants


def _plain(part: Any, path: str, found: dict[str, Any]) -> Any:
    if isinstance(part, list):
        return [_plain(each, _inner(path, each, index), found) for index, each in enumerate(part)]
    if not isinstance(part, dict):
        return part
    if "value" in part:
        found[path] = part
        return part["value"]
    return {key: _plain(each, f"{path}.{key}".lstrip("."), found) for key, each in part.items()}


def _inner(path: str, part: Any, index: int) -> str:
    return f"{path}.{part.get('name', index) if isinstance(part, dict) else index}"
