"""Effects drawn at random, and as text: ``heat_source:board2:0.8W:from=2h:to=3h:signal=radio_on``.

What is drawn is at a place whose temperature a diagnosing circuit knows, and large enough to matter. In text it is
``CAUSE[:PLACE][:SIZE][:KEY=VALUE]...``, or ``random``; what is left out is drawn from the run's seed, but a signal
only where neither size nor times are given. Keys are from, to, signal, body and scale, which multiplies what is drawn.
All faults of all effects are reported at once.
"""

import math
import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ambient_model.faults import Fault, Refused
from ambient_trainer.simulator.device import Device, load_device
from ambient_trainer.simulator.hidden import Hidden, checked, effects, outside_faults, run_faults
from ambient_trainer.simulator.run import stream


def choices(cause: str, device: Device) -> tuple[tuple[str | None, str | None], ...]:
    """Places where effects of a cause are drawn, and signals that drive them: as the device states, or anywhere."""
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
    open_to = [
        (place, signal)
        for place, signal in choices(cause, device)
        if given.get("location", place) == place and given.get("signal", signal) == signal
    ] or [(None, None)]
    place, signal = open_to[int(random.integers(len(open_to)))]
    place, signal = given.get("location", place), given.get("signal", signal)
    end_s = given.get("end_s")
    onset_s = float(round(begin * (duration_s if end_s is None else min(duration_s, max(end_s, 0.0)))))
    typical = next((each.size for each in device.hidden.get(cause, ()) if each.at == place), None) or effect.typical
    size = effect.drawn_size(scale * factor * typical, sign, chance, signal)
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


SOURCE = "--hide"
RANDOM = "random"
HELD = "held"
"""The size of a sensor that sticks at what it reads."""
_NONE = {"location": "all", "signal": "none", "end_s": "end", "size": HELD}
"""How a field is written that is None."""
_KEYS = {"from": "onset_s", "to": "end_s", "signal": "signal", "body": "body", "scale": "scale"}
_SIZE = re.compile(r"([+-]?(?:\d+\.?\d*|\.\d+)(?:e[+-]?\d+)?)(.*)", re.IGNORECASE | re.ASCII | re.DOTALL)
_ALSO: Mapping[str, Mapping[str, float]] = {
    "W": {"mW": 1e-3},
    "W/K": {"mW/K": 1e-3},
    "degC": {"K": 1.0},
    "s": {"min": 60.0},
    "": {"%": 0.01},
}
"""Other units that a size may be given in, by its own, with their factors."""
_TIMES = {"": 1.0, "s": 1.0, "min": 60.0, "h": 3600.0}


def parse_hidden(texts: Sequence[str], seed: int, duration_s: float, device: Device | None = None) -> list[Hidden]:
    """The effects that ``texts`` ask for in a run of ``duration_s``; raises :class:`Refused` with every fault."""
    device = device or load_device()
    found: list[Fault] = []
    hidden = []
    for number, text in enumerate(texts):
        cause, given, scale, faults = _parts(text)
        faults += outside_faults(given.get("onset_s"), given.get("end_s"), duration_s)
        known = {fault.place for fault in faults}
        random = stream(seed, f"hide {number}")
        if cause == RANDOM:
            cause = str(random.choice(list(effects())))
        try:
            hidden.append(draw_hidden(random, cause, duration_s, scale, device, **given))
        except Refused as refused:
            faults += [fault for fault in refused.faults if fault.place not in known]
        found += [Fault(f"{text!r}, {fault.place}", fault.problem, fault.hint) for fault in faults]
    if not found:
        found = list(run_faults(hidden, duration_s))
    if found:
        raise Refused(SOURCE, found)
    return hidden


def hidden_text(hidden: Hidden) -> str:
    """What reads as ``hidden`` again, whatever the seed."""
    parts = [
        hidden.cause,
        hidden.location or _NONE["location"],
        HELD if hidden.size is None else f"{hidden.size!r}{effects()[hidden.cause].unit}",
        f"from={hidden.onset_s!r}",
        f"to={_NONE['end_s'] if hidden.end_s is None else repr(hidden.end_s)}",
        f"signal={hidden.signal or _NONE['signal']}",
        *([f"body={hidden.body}"] if hidden.body else []),
    ]
    return ":".join(parts)


def _parts(text: str) -> tuple[str, dict[str, Any], float, list[Fault]]:
    """The cause, what is given by field, the scale, and what cannot be read."""
    cause, *parts = [part.strip() for part in text.split(":")]
    given: dict[str, Any] = {}
    found: list[Fault] = []
    for part in parts:
        key, equals, value = part.partition("=")
        if equals:
            if key not in _KEYS:
                found.append(Fault(part, "unknown key", f"take one of {', '.join(_KEYS)}"))
                continue
            name = _KEYS[key]
        else:
            name, value = "size" if part == HELD or _SIZE.match(part) else "location", part
            key = name
        if name in given:
            found.append(Fault(part, f"a second {name}", "give one"))
        try:
            given[name] = _read(name, value, cause)
        except ValueError as error:
            problem, hint = error.args
            found.append(Fault(key, problem, hint))
    scale = given.pop("scale", 1.0)
    if cause == RANDOM:
        fixed = [name for name in given if name not in ("onset_s", "end_s")]
        found += [Fault(name, "is drawn with 'random'", "name a cause, or leave it out") for name in fixed]
        given = {name: value for name, value in given.items() if name not in fixed}
    elif any(name in given for name in ("size", "onset_s", "end_s")):
        given.setdefault("signal", None)
    return cause, given, scale, found


def _read(name: str, text: str, cause: str) -> Any:
    """The value of a field; raises ValueError with problem and hint."""
    if text == _NONE.get(name):
        return None
    if name in ("location", "signal", "body"):
        return text
    match = _SIZE.fullmatch(text)
    if match is None:
        raise ValueError(f"{text!r} is not a number", "give one such as 2.5")
    number, unit = float(match[1]), match[2].strip()
    if name == "scale":
        if unit or not 0.0 <= number <= 1e3:
            raise ValueError(f"{text!r} is no factor", "give a number from 0 to 1000")
        return number
    if name in ("onset_s", "end_s"):
        if unit not in _TIMES:
            raise ValueError(f"{unit!r} is not a unit of time", "give it in s, min or h")
        return number * _TIMES[unit]
    if cause not in effects():
        return number
    own = effects()[cause].unit
    units = {**({own: 1.0} if own else {}), **_ALSO.get(own, {})}
    if unit and unit not in units:
        raise ValueError(f"{unit!r} is not a unit of it", f"give it in {' or '.join(units)}")
    return number * units.get(unit, 1.0)
