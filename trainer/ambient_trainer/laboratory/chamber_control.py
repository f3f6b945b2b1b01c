"""The chamber is kept at its target: the target is sent until the chamber's own answer confirms it.

That also holds after the chamber lost its power, or after it was changed by hand.
"""

from __future__ import annotations

from typing import NamedTuple

from ambient_trainer.laboratory.instruments import RUNNING, SET_POINT, ChamberDriver
from ambient_trainer.laboratory.messages import CHAMBER, Post, Timebase
from ambient_trainer.laboratory.reading import InstrumentError, Reading
from ambient_trainer.laboratory.worker import Worker, next_multiple

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
