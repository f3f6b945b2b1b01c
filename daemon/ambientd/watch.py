"""``ambientd watch``: what a running daemon says on its socket, for people; it goes on with the next daemon.

Lines go to standard output. That nothing comes, and that it comes again, is said once each on standard error. The
user's Ctrl-C is the end, and no failure.
"""

import math

from ambient_model.faults import refuse
from ambientd.client import Follower, Reading, clock_s
from ambientd.notices import say

_LOOK_S = 0.25


def watch(path: str, stale_after_s: float) -> None:
    """Print one line a tick until the user ends it; raises :class:`Refused` where no one listens at the beginning."""
    try:
        with Follower(path, math.inf) as follower:
            reading = follower.wait(0.0)
            if follower.problem:
                raise refuse(
                    path,
                    "",
                    f"no daemon listens there ({follower.problem})",
                    f"start one with 'ambientd run ... --publish socket:{path}'",
                )
            _go_on(follower, reading, stale_after_s)
    except KeyboardInterrupt:
        return


def _go_on(follower: Follower, reading: Reading | None, stale_after_s: float) -> None:
    heard_s = clock_s()
    told = False
    while True:
        if reading is not None:
            heard_s = clock_s()
            if told:
                say(f"{follower.path}: it is back")
            told = False
            print(as_text(reading), flush=True)
        elif not told and follower.problem:
            say(f"{follower.path}: the daemon has ended; waiting for the next")
            told = True
        elif not told and clock_s() - heard_s >= stale_after_s:
            skipped = f", but {follower.skipped} lines that are no readings" if follower.skipped else ""
            say(f"{follower.path}: nothing has come for {stale_after_s:g} s{skipped}; what was said last is stale")
            told = True
        reading = follower.wait(_LOOK_S)


def as_text(reading: Reading) -> str:
    """One line for people."""
    ambient = "no estimate"
    if reading.ambient_degC is not None:
        ambient = (
            f"{reading.ambient_degC:.2f} degC"
            f" ({_value(reading.low_degC)} to {_value(reading.high_degC)}, {reading.level_percent} %)"
        )
    sensors = "  ".join(f"{name} {_value(each.raw)}" for name, each in reading.sensors.items())
    return f"{reading.time_s:12.1f} s  {reading.status:<10}  {ambient}  {sensors}"


def _value(value: float | None) -> str:
    return "missing" if value is None else f"{value:.2f}"
