"""An effect drawn at random: at a place whose temperature a diagnosing circuit knows, and large enough to matter."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from ambient_trainer.simulator.effects.effect import KINDS, Hidden
from ambient_trainer.simulator.zones import THESIS_ZONES

Choice = tuple[str | None, str | None]
"""Place and signal."""

_HEATED: tuple[Choice, ...] = (
    *(("soc", None), ("soc", "radio_on"), ("flash", None), ("flash", "radio_on")),
    *(("board2", None), ("board2", "charger_on"), ("board2", "accessory_current_A")),
    *(("usb", None), ("usb", "charger_on"), ("usb", "accessory_current_A")),
    *(("display", None), ("display", "irradiance_W_m2")),
)
_COUPLED: tuple[Choice, ...] = (
    *((None, None), (None, "fan_on"), (None, "case_on"), (None, "wind_m_s")),
    *(("display", None), ("display", "fan_on"), ("display", "wind_m_s"), ("back", None), ("back", "case_on")),
)
_AT_A_SENSOR: tuple[Choice, ...] = tuple((zone, None) for zone in THESIS_ZONES)

CHOICES: Mapping[str, tuple[Choice, ...]] = {
    "heat_source": _HEATED,
    "ambient_coupling": _COUPLED,
    "contact": (("display", None), ("back", None)),
    "convection_law": ((None, None),),
    "thermal_mass": (("display", None), ("board2", None), ("back", None)),
    "path": (("flash-usb", None), ("soc-usb", None), ("soc-flash", None), ("soc-board2", None)),
    "sensor_bias": _AT_A_SENSOR,
    "sensor_gain": _AT_A_SENSOR,
    "sensor_lag": _AT_A_SENSOR,
    "sensor_stuck": _AT_A_SENSOR,
    "sensor_drift": _AT_A_SENSOR,
    "clock_offset": ((None, None),),
}
"""Where effects are drawn, and what drives them there."""

_TYPICAL: Mapping[str, float] = {
    "ambient_coupling": 1.0,
    "ambient_coupling.display": 1.9,
    "ambient_coupling.back": 2.0,
    "contact": 0.07,
    "convection_law": 2.2,
    "sensor_bias": 2.0,
    "sensor_gain": 0.12,
    "sensor_gain.soc": 0.05,
    "sensor_lag": 150.0,
    "sensor_lag.soc": 25.0,
    "sensor_drift": 1.0,
    "clock_offset": 120.0,
    "heat_source.soc": 0.13,
    "heat_source.flash": 0.15,
    "heat_source.board2": 0.3,
    "heat_source.usb": 0.14,
    "heat_source.display": 1.0,
    "thermal_mass.display": 180.0,
    "thermal_mass.board2": 30.0,
    "thermal_mass.back": 160.0,
    "path.flash-usb": 0.11,
    "path.soc-usb": 0.006,
    "path.soc-flash": 0.006,
    "path.soc-board2": 0.012,
}
"""The size at scale 1, by cause, or by cause and place: about 2 K in the sensor that feels it most in scenario 5."""
_SINCE_EVER = ("convection_law", "clock_offset")
_LASTING = (*_SINCE_EVER, "sensor_drift")
_STUCK_DEGC = (15.0, 40.0)


def draw_hidden(random: np.random.Generator, cause: str, duration_s: float, scale: float = 1.0, **given: Any) -> Hidden:
    """An effect of ``cause`` in a run of ``duration_s``, ``scale`` times the typical size, give or take a third.

    What is ``given``, by the names of :class:`Hidden`'s fields, is not drawn. What has a signal follows it all the
    time; what has none begins within the run, but a law or a clock is so since ever. Raises :class:`Refused` with every
    fault of what is given.
    """
    if cause not in KINDS:
        return Hidden(cause, **given)
    spread, sign = 1.5 ** random.uniform(-1.0, 1.0), random.choice([-1.0, 1.0])
    begin, length, for_good = random.uniform(0.2, 0.5), random.uniform(0.2, 0.4), random.random() < 0.5
    stuck_degC = round(float(random.uniform(*_STUCK_DEGC)), 1)
    choices = [each for each in CHOICES[cause] if _agrees(each, given)] or [(None, None)]
    place, signal = choices[int(random.integers(len(choices)))]
    place, signal = given.get("location", place), given.get("signal", signal)
    end_s = given.get("end_s")
    onset_s = float(round(begin * (duration_s if end_s is None else min(duration_s, max(end_s, 0.0)))))
    drawn: dict[str, Any] = {
        "location": place,
        "signal": signal,
        "onset_s": 0.0 if signal or cause in _SINCE_EVER else onset_s,
        "end_s": None,
        "size": stuck_degC if cause == "sensor_stuck" else _size(cause, place, signal, scale * spread, sign),
    }
    if not (for_good or signal or cause in _LASTING):
        begun_s = given.get("onset_s", onset_s)
        if begun_s < duration_s:
            drawn["end_s"] = begun_s + math.ceil(length * (duration_s - begun_s))
    return Hidden(cause, **{**drawn, **given})


def draw_any(random: np.random.Generator, duration_s: float, scale: float = 1.0, **given: Any) -> Hidden:
    """An effect of any cause."""
    cause = str(random.choice(list(KINDS)))
    return draw_hidden(random, cause, duration_s, scale, **given)


def _agrees(choice: Choice, given: Mapping[str, Any]) -> bool:
    place, signal = choice
    return given.get("location", place) == place and given.get("signal", signal) == signal


def _size(cause: str, place: str | None, signal: str | None, scale: float, sign: float) -> float:
    typical = scale * _TYPICAL.get(f"{cause}.{place}", _TYPICAL.get(cause, 0.1))
    kind = KINDS[cause]
    if cause == "ambient_coupling":
        cooled = signal in ("fan_on", "wind_m_s") or (signal is None and sign < 0.0)
        typical = 1.0 / (1.0 + typical) - 1.0 if cooled else typical
    elif kind.low < 0.0:
        typical *= sign
    return float(np.clip(float(f"{typical:.3g}"), kind.low, kind.high))
