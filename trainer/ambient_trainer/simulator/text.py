"""An effect as the command line writes it: ``heat_source:board2:0.8W:from=2h:to=3h:signal=radio_on``.

``CAUSE[:PLACE][:SIZE][:KEY=VALUE]...``, or ``random``; what is left out is drawn from the run's seed, but a signal
only where neither size nor times are given. Keys are from, to, signal, body and scale, which multiplies what is drawn.
All faults of all effects are reported at once.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ambient_model.faults import Fault, Refused
from ambient_trainer.simulator.device import Device
from ambient_trainer.simulator.device_file import load_device
from ambient_trainer.simulator.draw import draw_any, draw_hidden
from ambient_trainer.simulator.hidden import Hidden, effects, outside_faults, run_faults
from ambient_trainer.simulator.run import stream

SOURCE = "--hide"
RANDOM = "random"
HELD = "held"
"""The size of a sensor that sticks at what it reads."""
_EVERYWHERE, _NO_SIGNAL, _FOR_GOOD = "all", "none", "end"
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


@dataclass(frozen=True)
class Wish:
    """What a text asks for; the rest is drawn. ``cause`` None: any."""

    text: str
    cause: str | None
    given: Mapping[str, Any]
    scale: float = 1.0


def parse_hidden(texts: Sequence[str], seed: int, duration_s: float, device: Device | None = None) -> list[Hidden]:
    """The effects that ``texts`` ask for in a run of ``duration_s``; raises :class:`Refused` with every fault."""
    device = device or load_device()
    found: list[Fault] = []
    hidden = []
    for number, text in enumerate(texts):
        wish, unread = read_wish(text)
        outside = outside_faults(wish.given.get("onset_s"), wish.given.get("end_s"), duration_s)
        unread += outside
        effect, wrong = _granted(wish, stream(seed, f"hide {number}"), duration_s, device)
        known = {fault.place for fault in unread}
        found += [_placed(text, fault) for fault in [*unread, *[each for each in wrong if each.place not in known]]]
        hidden += [effect] if effect else []
    if not found:
        found = run_faults(hidden, duration_s)
    if found:
        raise Refused(SOURCE, found)
    return hidden


def hidden_text(hidden: Hidden) -> str:
    """What reads as ``hidden`` again, whatever the seed."""
    parts = [
        hidden.cause,
        hidden.location or _EVERYWHERE,
        HELD if hidden.size is None else f"{hidden.size!r}{effects()[hidden.cause].unit}",
        f"from={hidden.onset_s!r}",
        f"to={_FOR_GOOD if hidden.end_s is None else repr(hidden.end_s)}",
        f"signal={hidden.signal or _NO_SIGNAL}",
        *([f"body={hidden.body}"] if hidden.body else []),
    ]
    return ":".join(parts)


def read_wish(text: str) -> tuple[Wish, list[Fault]]:
    """What a text asks for, and what of it cannot be read."""
    cause, *parts = [part.strip() for part in text.split(":")]
    given: dict[str, Any] = {}
    found: list[Fault] = []
    for part in parts:
        key, equals, value = part.partition("=")
        if equals:
            name, read = _KEYS.get(key, (key, None))
            if read is None:
                found.append(Fault(part, "unknown key", f"take one of {', '.join(_KEYS)}"))
                continue
        elif part == HELD or _SIZE.match(part):
            name, value, read = "size", part, _size
        else:
            name, value, read = "location", part, _place
        if name in given:
            found.append(Fault(part, f"a second {name}", "give one"))
        try:
            given[name] = read(value, cause)
        except ValueError as error:
            problem, hint = error.args
            found.append(Fault(_PLACES.get(name, name), problem, hint))
    scale = given.pop("scale", 1.0)
    if cause == RANDOM:
        fixed = [name for name in given if name not in ("onset_s", "end_s")]
        found += [Fault(name, "what is random has its own", "name a cause, or leave it out") for name in fixed]
        given = {name: value for name, value in given.items() if name not in fixed}
    elif any(name in given for name in ("size", "onset_s", "end_s")):
        given.setdefault("signal", None)
    return Wish(text, None if cause == RANDOM else cause, given, scale), found


def _granted(
    wish: Wish, random: np.random.Generator, duration_s: float, device: Device
) -> tuple[Hidden | None, tuple[Fault, ...]]:
    if wish.cause is not None and wish.cause not in effects():
        hint = f"take one of {', '.join(effects())}, or {RANDOM}"
        return None, (Fault("cause", f"{wish.cause!r} is none", hint),)
    try:
        if wish.cause is None:
            return draw_any(random, duration_s, wish.scale, device, **wish.given), ()
        return draw_hidden(random, wish.cause, duration_s, wish.scale, device, **wish.given), ()
    except Refused as refused:
        return None, refused.faults


def _placed(text: str, fault: Fault) -> Fault:
    return Fault(f"{text!r}, {fault.place}", fault.problem, fault.hint)


def _place(text: str, _: str) -> str | None:
    return None if text == _EVERYWHERE else text


def _size(text: str, cause: str) -> float | None:
    if text == HELD:
        return None
    number, unit = _matched(text, "a number with its unit")
    if cause not in effects():
        return number
    own = effects()[cause].unit
    units = {**({own: 1.0} if own else {}), **_ALSO.get(own, {})}
    if unit and unit not in units:
        raise ValueError(f"{unit!r} is not a unit of it", f"give it in {' or '.join(units)}")
    return number * units.get(unit, 1.0)


def _time(text: str, _: str) -> float:
    number, unit = _matched(text, "a time")
    if unit not in _TIMES:
        raise ValueError(f"{unit!r} is not a unit of time", "give it in s, min or h")
    return number * _TIMES[unit]


def _end(text: str, cause: str) -> float | None:
    return None if text == _FOR_GOOD else _time(text, cause)


def _signal(text: str, _: str) -> str | None:
    return None if text == _NO_SIGNAL else text


def _body(text: str, _: str) -> str:
    return text


def _scale(text: str, _: str) -> float:
    number, unit = _matched(text, "a factor")
    if unit or not 0.0 <= number <= 1e3:
        raise ValueError(f"{text!r} is no factor", "give a number from 0 to 1000")
    return number


def _matched(text: str, what: str) -> tuple[float, str]:
    match = _SIZE.fullmatch(text)
    if match is None:
        raise ValueError(f"{text!r} is not {what}", "give a number such as 2.5")
    return float(match[1]), match[2].strip()


_KEYS = {
    "from": ("onset_s", _time),
    "to": ("end_s", _end),
    "signal": ("signal", _signal),
    "body": ("body", _body),
    "scale": ("scale", _scale),
}
_PLACES = {"onset_s": "from", "end_s": "to"}
