"""An effect drawn at random: at a place whose temperature a diagnosing circuit knows, and large enough to matter."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from ambient_trainer.simulator.device import Device
from ambient_trainer.simulator.device_file import load_device
from ambient_trainer.simulator.hidden import Effect, Hidden, checked, effects

Choice = tuple[str | None, str | None]
"""Place and signal."""


def choices(cause: str, device: Device) -> tuple[Choice, ...]:
    """Where effects of a cause are drawn, and what drives them there: as the device states, or anywhere."""
    stated = tuple((place.at, signal) for place in device.hidden.get(cause, ()) for signal in place.signals)
    places = effects()[cause].places(device)
    return stated or tuple((place, None) for place in places) or ((None, None),)


def draw_hidden(
    random: np.random.Generator,
    cause: str,
    duration_s: float,
    scale: float = 1.0,
    device: Device | None = None,
    **given: Any,
) -> Hidden:
    """An effect of ``cause`` in a run of ``duration_s``, ``scale`` times the typical size, give or take a third.

    What is ``given``, by the names of :class:`Hidden`'s fields, is not drawn. What has a signal follows it all the
    time; what has none begins within the run, or lasts since ever where its cause does. Raises :class:`Refused` with
    every fault of what is given.
    """
    device = device or load_device()
    effect = effects().get(cause)
    if effect is None:
        return checked(Hidden(cause, **given), device)
    factor, sign = 1.5 ** random.uniform(-1.0, 1.0), random.choice([-1.0, 1.0])
    begin, length, to_the_end = random.uniform(0.2, 0.5), random.uniform(0.2, 0.4), random.random() < 0.5
    chance = random.uniform()
    open_to = [each for each in choices(cause, device) if _agrees(each, given)] or [(None, None)]
    place, signal = open_to[int(random.integers(len(open_to)))]
    place, signal = given.get("location", place), given.get("signal", signal)
    end_s = given.get("end_s")
    onset_s = float(round(begin * (duration_s if end_s is None else min(duration_s, max(end_s, 0.0)))))
    size = effect.drawn_size(scale * factor * _typical(cause, effect, device, place), sign, chance, signal)
    drawn: dict[str, Any] = {
        "location": place,
        "signal": signal,
        "onset_s": 0.0 if signal or effect.since_ever else onset_s,
        "end_s": None,
        "size": float(np.clip(float(f"{size:.3g}"), effect.low, effect.high)),
    }
    if not (to_the_end or signal or effect.since_ever or effect.for_good):
        begun_s = given.get("onset_s", onset_s)
        if begun_s < duration_s:
            drawn["end_s"] = begun_s + math.ceil(length * (duration_s - begun_s))
    return checked(Hidden(cause, **{**drawn, **given}), device)


def _agrees(choice: Choice, given: Mapping[str, Any]) -> bool:
    place, signal = choice
    return given.get("location", place) == place and given.get("signal", signal) == signal


def _typical(cause: str, effect: Effect, device: Device, place: str | None) -> float:
    stated = (each.size for each in device.hidden.get(cause, ()) if each.at == place)
    return next(stated, None) or effect.typical
