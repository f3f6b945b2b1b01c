"""``ambientd watch``: the lines of a running daemon's socket, for people; it continues with the next daemon.

Lines go to standard output; that they stop, and that they return, is reported once each on standard error. The user's
Ctrl-C ends it, and is no failure.
"""

import math

from ambient_model.faults import refuse
from ambientd.client import Follower, Reading, clock_s
from ambientd.notices import log

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
    last_s = clock_s()
    reported = False
    while True:
        if reading is not None:
            last_s = clock_s()
            if reported:
                log(f"{follower.path}: it is back")
            reported = False
            print(as_text(reading), flush=True)
        elif not reported and follower.problem:
            log(f"{follower.path}: the daemon has ended; waiting for the next")
            reported = True
        elif not reported and clock_s() - last_s >= stale_after_s:
            skipped = f", but {follower.skipped} lines that are no readings" if follower.skipped else ""
            log(f"{follower.path}: nothing has come for {stale_after_s:g} s{skipped}; the last reading is stale")
            reported = True
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
