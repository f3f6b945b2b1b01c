"""The threads of a run. Each instrument is asked on its own absolute schedule: a slow one delays no other.

A query that was due while the last one was still out is left out. The chamber is kept at its target, which is sent
until the chamber's own answer confirms it, and no set point waits for a gradient; the device is kept at the actions
that a step asks for, also after it was lost. Actions go over a shell of their own: one that takes seconds delays no
sample.
"""

from __future__ import annotations

import logging
import math
import threading
from typing import TYPE_CHECKING, NamedTuple

from ambient_trainer.laboratory import messages
from ambient_trainer.laboratory.instruments import RUNNING, SET_POINT, ChamberDriver, Driver
from ambient_trainer.laboratory.messages import CHAMBER, DEVICE, Clock, Disconnected, InstrumentError, Post, Reading
from ambient_trainer.laboratory.shell import Connection, Shell

if TYPE_CHECKING:
    from ambient_trainer.laboratory.campaign import Laboratory  # the watchdog does not wait for it

_log = logging.getLogger(__name__)


class Worker(threading.Thread):
    """A thread of a run: ``turn`` is called until ``finish``, then ``held`` closed; what it raises is its ``crash``."""

    def __init__(self, source: str, clock: Clock, post: Post, held: Driver | Shell) -> None:
        super().__init__(name=source, daemon=True)
        self.source, self.clock, self.post, self._held = source, clock, post, held
        self.woken, self.finished = threading.Event(), False
        self.crash: BaseException | None = None

    def turn(self) -> float:
        """Do what is due; returns the time of the next turn."""
        raise NotImplementedError

    def finish(self) -> None:
        """Ask the thread to end; it may be in an exchange, so join it with patience."""
        self.finished = True
        self.woken.set()

    def failed(self, error: InstrumentError | str, again_after_s: float = 0.0, source: str = "") -> float:
        """Post a failure, of another ``source`` if there is one; returns the time of the next attempt."""
        now_s = self.clock.now_s()
        self.post(messages.Failure(source or self.source, now_s, str(error)))
        return now_s + again_after_s

    def run(self) -> None:
        """The thread's life."""
        try:
            while not self.finished:
                due_s = self.turn()
                while not self.finished and (left_s := due_s - self.clock.now_s()) > 0.0:
                    if self.clock.wait(self.woken, left_s):
                        break
                self.woken.clear()
        except BaseException as error:
            self.crash = error
        finally:
            self._held.close()


class Sampler(Worker):
    """Takes a sample at every multiple of ``period_s``, the first one in its second turn."""

    def __init__(self, source: str, instrument: Driver, period_s: float, clock: Clock, post: Post) -> None:
        super().__init__(source, clock, post, instrument)
        self._instrument, self._period_s, self._scheduled = instrument, period_s, False

    def turn(self) -> float:
        try:
            if self._scheduled:
                self.post(messages.Sample(self.source, *self._instrument.read()))
        except InstrumentError as error:
            self.failed(error)
        self._scheduled = True
        return next_multiple(self.clock.now_s(), self._period_s)


def next_multiple(now_s: float, period_s: float) -> float:
    """The first multiple of ``period_s`` after ``now_s``."""
    return (math.floor(now_s / period_s + 1e-9) + 1) * period_s


RESOLUTION_K = 0.06
"""A set point that is reported this near is the one that was sent: controllers have tenths."""
_BEHIND_MIN, _BEHIND_K = 1.0, 0.5
"""How far a nominal value that moves under a gradient may be from the straight line; chosen."""
_LEAST_WALL_S = 10.0  # however fast the clock, a loaded machine may need this long to confirm
_RETRY_S = 1.0
_QUICK_RETRIES = 5  # after so many attempts the next ones come once a period; a gradient is then given up


class Target(NamedTuple):
    """The state to hold: the set point (None: stop), and how fast it may move (0: as it can, None: as set before).

    Under a gradient, the nominal value that the chamber reports is still on its way; an urgent set point goes out
    before the gradient is lifted, any other after the gradient was sent.
    """

    set_degC: float | None
    gradient_K_min: float | None = None
    urgent: bool = False

    def __str__(self) -> str:
        return "a stop" if self.set_degC is None else f"the set point {self.set_degC:.1f} degC"

    def confirmed_by(self, reading: Reading, moving_K: float = 0.0) -> bool:
        """Whether the chamber's ``reading`` agrees, its nominal value at most ``moving_K`` away."""
        running, reported_degC = bool(reading.values[RUNNING]), reading.values[SET_POINT] or 0.0
        if self.set_degC is None:
            return not running
        return running and abs(reported_degC - self.set_degC) <= RESOLUTION_K + moving_K


class ChamberControl(Worker):
    """Holds the chamber at the newest target and samples it.

    What is not confirmed within ``confirm_s``, and a gradient that is refused, is posted as a failure with what was
    asked for and what the chamber reports.
    """

    def __init__(
        self, chamber: ChamberDriver, clock: Clock, post: Post, period_s: float, target: Target, confirm_s: float
    ) -> None:
        super().__init__(CHAMBER, clock, post, chamber)
        self.target = target
        self.error: InstrumentError | None = None
        """Why the newest turn failed, or None."""
        self._chamber, self._period_s, self._confirm_s = chamber, period_s, confirm_s
        self._confirmed: Target | None = None
        self._got, self._gradient_attempts = "", 0
        self._reported_degC: float | None = None
        self._begin(target)

    @property
    def confirmed(self) -> bool:
        """Whether the chamber's own answer agrees with the newest target."""
        return self._confirmed is self.target

    @property
    def settled(self) -> bool:
        """Whether there is nothing left to send: the target is confirmed, its gradient taken or given up."""
        return self.confirmed and not self._gradient_attempts

    def go_to(self, target: Target) -> None:
        """Hold another target from now on; returns at once."""
        self.target = target
        self.woken.set()

    def turn(self) -> float:
        """Send what is not confirmed, and read the chamber."""
        target, self.error = self.target, None
        if target is not self._begun:
            self._begin(target)
        try:
            if target.urgent:
                self._send(target)
            self._send_gradient(target)
            self._send(target)
            reading = self._chamber.read()
        except InstrumentError as error:
            self.error = error
            self._check_overdue("no answer")
            return self.failed(error, _RETRY_S)
        agrees = target.confirmed_by(reading, self._moving_K(target, reading))
        self._to_send, self._confirmed = not agrees, target if agrees else None
        self._reported_degC = reading.values[SET_POINT]
        state = "running" if reading.values[RUNNING] else "stopped"
        self._check_overdue(f"a nominal value of {self._reported_degC:.1f} degC, {state}")
        self.post(messages.Sample(CHAMBER, *reading))
        if not self.settled and self._attempts < _QUICK_RETRIES:
            return self.clock.now_s() + _RETRY_S
        return next_multiple(self.clock.now_s(), self._period_s)

    def _begin(self, target: Target) -> None:
        if self._got and target.set_degC is not None:  # a stop is an alarm's, and has its own failure
            self._fail_set_point()
        if self._gradient_attempts:
            self._fail_gradient()
        self._begun, self._from_degC = target, self._reported_degC
        self._begun_s = self._agreed_s = self.clock.now_s()
        self._to_send, self._overdue, self._attempts, self._got = True, False, 0, ""
        self._gradient_attempts = 0 if None in (target.set_degC, target.gradient_K_min) else _QUICK_RETRIES
        self._gradient_error: InstrumentError | None = None

    def _send(self, target: Target) -> None:
        if not self._to_send:
            return
        self._attempts += 1
        _log.info("%s is sent", target)
        if target.set_degC is None:
            self._chamber.stop()
        else:
            self._chamber.set_point(target.set_degC)
        self._to_send = False

    def _send_gradient(self, target: Target) -> None:
        """Limit how fast the set point moves; a chamber that refuses it goes to its set point all the same."""
        if not self._gradient_attempts or target.set_degC is None or target.gradient_K_min is None:
            return
        _log.info("the gradient %g K/min is sent", target.gradient_K_min)
        try:
            self._chamber.gradient(target.gradient_K_min, rising=target.set_degC >= (self._from_degC or 0.0))
            self._gradient_attempts = 0
        except Disconnected:
            raise
        except InstrumentError as error:
            _log.info("%s", error)
            self._gradient_attempts, self._gradient_error = self._gradient_attempts - 1, error
            if not self._gradient_attempts:
                self._fail_gradient()

    def _moving_K(self, target: Target, reading: Reading) -> float:
        """How far from the target the nominal value may still be, on its way under the target's gradient."""
        if not target.gradient_K_min or target.set_degC is None:
            return 0.0
        if self._from_degC is None:
            self._from_degC = reading.values[SET_POINT] or 0.0
        minutes = max((self.clock.now_s() - self._begun_s) / 60.0 - _BEHIND_MIN, 0.0)
        return max(abs(target.set_degC - self._from_degC) - target.gradient_K_min * minutes, 0.0) + _BEHIND_K

    def _check_overdue(self, reported: str) -> None:
        """Post a failure where the target has not been confirmed for too long, and when that is over."""
        now_s = self.clock.now_s()
        if self._confirmed is self._begun:  # whatever the newest target is by now
            self._agreed_s, self._got = now_s, ""
            if self._overdue:
                self.post(messages.Recovered(messages.CHAMBER_SET_POINT, now_s))
            self._overdue = False
        else:
            self._got = reported
            if now_s - self._agreed_s > max(self._confirm_s, _LEAST_WALL_S * self.clock.speed):
                self._fail_set_point()

    def _fail_set_point(self) -> None:
        if not self._overdue:
            self._overdue = True
            hint = "compare it with the chamber's panel: is it in manual or program mode, is its layout another?"
            text = f"{CHAMBER}: expected {self._begun} within {self._confirm_s:g} s, got {self._got}; {hint}"
            self.failed(text, source=CHAMBER if self._begun.urgent else messages.CHAMBER_SET_POINT)

    def _fail_gradient(self) -> None:
        if self._gradient_error is not None:
            self.failed(self._gradient_error, source=CHAMBER if self._begun.urgent else messages.CHAMBER_GRADIENT)


_PERIOD_S, _LOAD_RETRY_S = 2.0, 5.0
_TIMEOUT_S = 60.0  # a camera takes its time


class LoadControl(Worker):
    """Keeps the device at the actions that were last asked for."""

    def __init__(self, laboratory: Laboratory, connection: Connection, clock: Clock, post: Post) -> None:
        self.shell, self._actions = Shell(connection, clock, _TIMEOUT_S, laboratory.device.setup), laboratory.actions
        super().__init__(f"{DEVICE}'s actions", clock, post, self.shell)
        self._target: tuple[str, ...] = ()
        self._active: tuple[str, ...] | None = None

    @property
    def confirmed(self) -> bool:
        """Whether the newest target is what is active."""
        return self._active == self._target

    def go_to(self, actions: tuple[str, ...]) -> None:
        """Keep these active from now on; returns at once."""
        self._target = actions
        self.woken.set()

    def turn(self) -> float:
        target = self._target
        try:
            if self._active is not None and not self.shell.alive:
                self._set_active(None)
                self.shell.close()
            if self._active is None:  # a known state: nothing is active
                self._change(tuple(reversed(self._actions)), ())
            if self._active != target:
                self._change(self._active or (), target)
        except InstrumentError as error:
            self._set_active(None)
            return self.failed(error, _LOAD_RETRY_S)
        return self.clock.now_s() + _PERIOD_S

    def _change(self, active: tuple[str, ...], target: tuple[str, ...]) -> None:
        orders = [(name, "stop") for name in reversed(active) if name not in target]
        orders += [(name, "start") for name in target if name not in active]
        for name, what in orders:
            if status := self.shell.run(getattr(self._actions[name], what)).status:
                expected, got = f"action {name} to {what}", f"exit status {status}"
                hint = "try the command in a shell on the device; it is tried again"
                raise InstrumentError(DEVICE, self.shell.label, expected, got, hint)
        self._set_active(target)

    def _set_active(self, actions: tuple[str, ...] | None) -> None:
        if actions != self._active:
            self._active = actions
            self.post(messages.LoadState(self.clock.now_s(), actions))
