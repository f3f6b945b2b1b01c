"""The threads of a run. Each instrument is asked on its own absolute schedule: a slow one delays no other.

A query that was due while the last one was still out is left out. The chamber is kept at its target, which is sent
until the chamber's own answer confirms it; the device at the actions that a step asks for, also after it was lost.
Actions go over a shell of their own: one that takes seconds delays no sample.
"""

from __future__ import annotations

import math
import threading
from typing import TYPE_CHECKING, NamedTuple

from ambient_trainer.laboratory.instruments import RUNNING, SET_POINT, ChamberDriver, Driver
from ambient_trainer.laboratory.messages import (
    CHAMBER,
    DEVICE,
    Crash,
    Failure,
    InstrumentError,
    LoadState,
    Post,
    Reading,
    Timebase,
)
from ambient_trainer.laboratory.shell import Connection, Shell

if TYPE_CHECKING:
    from ambient_trainer.laboratory.campaign import Laboratory  # the watchdog does not wait for it


class Worker(threading.Thread):
    """A thread of a run: ``turn`` is called again and again until ``finish``; what it raises is posted as a crash."""

    def __init__(self, source: str, timebase: Timebase, post: Post) -> None:
        super().__init__(name=source, daemon=True)
        self.source = source
        self.timebase = timebase
        self.post = post
        self.woken = threading.Event()
        self.finished = False

    def turn(self) -> float:
        """Do what is due; returns the run's time of the next turn."""
        raise NotImplementedError

    def close(self) -> None:
        """Let go of what the thread holds; called in it at the end."""

    def finish(self) -> None:
        """Ask the thread to end; it may be in an exchange, so join it with patience."""
        self.finished = True
        self.woken.set()

    def failed(self, error: InstrumentError, again_after_s: float) -> float:
        """Post ``error``; returns the run's time of the next attempt."""
        now_s = self.timebase.now_s()
        self.post(Failure(self.source, now_s, str(error)))
        return now_s + again_after_s

    def run(self) -> None:
        """The thread's life."""
        try:
            while not self.finished:
                due_s = self.turn()
                while not self.finished and (left_s := due_s - self.timebase.now_s()) > 0.0:
                    if self.timebase.clock.wait(self.woken, left_s):
                        break
                if not self.finished:
                    self.woken.clear()
        except BaseException as error:
            self.post(Crash(self.source, error))
        finally:
            self.close()


class Sampler(Worker):
    """Takes a sample at every multiple of ``period_s``, the first one in its second turn."""

    def __init__(self, source: str, instrument: Driver, period_s: float, timebase: Timebase, post: Post) -> None:
        super().__init__(source, timebase, post)
        self._instrument = instrument
        self._period_s = period_s
        self._scheduled = False

    def turn(self) -> float:
        """Read the instrument, and post the sample."""
        try:
            if self._scheduled:
                self.post(self.timebase.sample(self.source, self._instrument.read()))
        except InstrumentError as error:
            self.failed(error, 0.0)
        self._scheduled = True
        return next_multiple(self.timebase.now_s(), self._period_s)

    def close(self) -> None:
        """Close the instrument."""
        self._instrument.close()


def next_multiple(now_s: float, period_s: float) -> float:
    """The first multiple of ``period_s`` after ``now_s``."""
    return (math.floor(now_s / period_s) + 1) * period_s


RESOLUTION_K = 0.06
"""A set point that is reported this near is the one that was sent: controllers have tenths."""
_RETRY_S = 1.0


class Target(NamedTuple):
    """The state to hold: the set point (None: stop), and how fast it may move (None: as fast as it can).

    The set point of one that is ``urgent`` goes out before its gradient.
    """

    set_degC: float | None
    gradient_K_min: float | None = None
    urgent: bool = False

    def confirmed_by(self, reading: Reading) -> bool:
        """Whether the chamber's ``reading`` agrees; under a gradient its nominal value is still on its way."""
        if self.set_degC is None:
            return not reading.values[RUNNING]
        reported_degC = reading.values[SET_POINT]
        assert reported_degC is not None, "a chamber reports its set point"
        on_target = bool(self.gradient_K_min) or abs(reported_degC - self.set_degC) <= RESOLUTION_K
        return bool(reading.values[RUNNING]) and on_target


class ChamberControl(Worker):
    """Holds the chamber at the newest target and samples it; ``gradients``: whether any target has one."""

    def __init__(
        self,
        chamber: ChamberDriver,
        timebase: Timebase,
        post: Post,
        period_s: float,
        target: Target,
        gradients: bool,
    ) -> None:
        super().__init__(CHAMBER, timebase, post)
        self.target = target
        self._chamber = chamber
        self._period_s = period_s
        self._gradients = gradients
        self._sent: Target | None = None
        self._confirmed: Target | None = None

    @property
    def confirmed(self) -> bool:
        """Whether the chamber's own answer agrees with the newest target."""
        return self._confirmed is self.target

    def go_to(self, target: Target) -> None:
        """Hold another target from now on; returns at once."""
        self.target = target
        self.woken.set()

    def turn(self) -> float:
        """Send the target where it is not confirmed, and read the chamber."""
        target = self.target
        try:
            if self._sent is not target:
                self._send(target)
                self._sent = target
            reading = self._chamber.read()
        except InstrumentError as error:
            return self.failed(error, _RETRY_S)
        self._sent = self._confirmed = target if target.confirmed_by(reading) else None
        self.post(self.timebase.sample(CHAMBER, reading))
        now_s = self.timebase.now_s()
        return now_s + _RETRY_S if self._sent is None else next_multiple(now_s, self._period_s)

    def close(self) -> None:
        """Close the line; the chamber goes on as it is."""
        self._chamber.close()

    def _send(self, target: Target) -> None:
        if target.set_degC is None:
            self._chamber.stop()
            return
        if target.urgent:
            self._chamber.set_point(target.set_degC)
        if self._gradients:  # else the chamber's own stays as it is
            self._chamber.gradient(target.gradient_K_min or 0.0)
        if not target.urgent:
            self._chamber.set_point(target.set_degC)


_PERIOD_S = 2.0
_LOAD_RETRY_S = 5.0
_TIMEOUT_S = 60.0
"""A camera takes its time."""
_FAILED = "try the command in a shell on the device; it is tried again"


class LoadControl(Worker):
    """Keeps the device at the actions that were last asked for."""

    def __init__(self, laboratory: Laboratory, connection: Connection, timebase: Timebase, post: Post) -> None:
        super().__init__(f"{DEVICE}'s actions", timebase, post)
        self.shell = Shell(connection, timebase.clock, _TIMEOUT_S, laboratory.device.setup)
        self._actions = laboratory.actions
        self._target: tuple[str, ...] = ()
        self._active: tuple[str, ...] | None = None
        self._posted: tuple[str, ...] | None = None

    @property
    def confirmed(self) -> bool:
        """Whether the newest target is what is active."""
        return self._active == self._target

    def go_to(self, actions: tuple[str, ...]) -> None:
        """Keep these active from now on; returns at once."""
        self._target = actions
        self.woken.set()

    def turn(self) -> float:
        """Stop what is not in the target, start what is."""
        target = self._target
        try:
            if self._active is not None and not self.shell.alive:
                self._set_active(None)
                self.shell.close()
            if self._active is None:  # a known state: nothing is active
                for name in self._actions:
                    self._run(name, "stop")
                self._set_active(())
            if self._active != target:
                self._change(self._active or (), target)
        except InstrumentError as error:
            self._set_active(None)
            return self.failed(error, _LOAD_RETRY_S)
        return self.timebase.now_s() + _PERIOD_S

    def close(self) -> None:
        """Close the shell."""
        self.shell.close()

    def _change(self, active: tuple[str, ...], target: tuple[str, ...]) -> None:
        for name in reversed(active):
            if name not in target:
                self._run(name, "stop")
        for name in target:
            if name not in active:
                self._run(name, "start")
        self._set_active(target)

    def _set_active(self, actions: tuple[str, ...] | None) -> None:
        self._active = actions
        if actions != self._posted:
            self._posted = actions
            self.post(LoadState(self.timebase.now_s(), actions))

    def _run(self, name: str, what: str) -> None:
        action = self._actions[name]
        status = self.shell.run(action.start if what == "start" else action.stop).status
        if status:
            raise InstrumentError(
                DEVICE, self.shell.label, f"action {name} to {what}", f"exit status {status}", _FAILED
            )
