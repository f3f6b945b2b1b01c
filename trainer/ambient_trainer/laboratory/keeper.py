"""The chamber is kept where it is wanted: told again until its own answer confirms it, also after it lost its power."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from ambient_trainer.laboratory.instruments.chamber import Chamber
from ambient_trainer.laboratory.instruments.readings import ChamberReading
from ambient_trainer.laboratory.line import LineError
from ambient_trainer.laboratory.messages import CHAMBER, Post, Sample, Timebase, Trouble
from ambient_trainer.laboratory.sampler import Worker, following

SET, ACTUAL, RUNNING = "chamber_set_degC", "chamber_degC", "chamber_on"
_AGREES_K = 0.06
"""The controller speaks in tenths."""
_RETRY_S = 1.0


class Wish(NamedTuple):
    """What the chamber shall do."""

    set_degC: float | None
    """None: stop."""
    gradient_K_min: float | None = None
    """How fast the set point may move; None: as fast as it can."""
    urgent: bool = False
    """The set point goes out before anything else."""


class Keeper(Worker):
    """Holds the chamber at the newest wish and samples it; ``gradients``: whether any wish has one."""

    def __init__(
        self, chamber: Chamber, timebase: Timebase, post: Post, period_s: float, wish: Wish, gradients: bool
    ) -> None:
        super().__init__(CHAMBER, timebase, post)
        self._chamber = chamber
        self._period_s = period_s
        self._gradients = gradients
        self._wish = wish
        self._sent: Wish | None = None
        self._confirmed: Wish | None = None

    @property
    def wish(self) -> Wish:
        """What is wanted now."""
        return self._wish

    @property
    def confirmed(self) -> bool:
        """Whether the chamber said that it does what is wanted now."""
        return self._confirmed is self._wish

    def want(self, wish: Wish) -> None:
        """Want something else from now on; returns at once."""
        self._wish = wish
        self.woken.set()

    def turn(self) -> float:
        """Tell the chamber where it does not do what is wanted; ask what it does."""
        wish = self._wish
        try:
            if self._sent is not wish:
                for tell in self._orders(wish):
                    tell()
                self._sent = wish
            reading = self._chamber.read()
        except LineError as error:
            self.post(Trouble(self.source, self.timebase.now_s(), str(error)))
            return self.timebase.now_s() + _RETRY_S
        of, values = self.timebase.of, {SET: reading.set_degC, ACTUAL: reading.actual_degC}
        values[RUNNING] = float(reading.running)
        agrees = _agrees(reading, wish)
        if agrees:
            self._confirmed = wish
        self.post(Sample(CHAMBER, of(reading.asked_s), of(reading.answered_s), values, reading.alarm))
        if not agrees:
            self._sent = None
            return self.timebase.now_s() + _RETRY_S
        return following(self.timebase.now_s(), self._period_s)

    def leave(self) -> None:
        """Close the line; the chamber goes on as it is."""
        self._chamber.close()

    def _orders(self, wish: Wish) -> list[Callable[[], None]]:
        set_degC = wish.set_degC
        if set_degC is None:
            return [self._chamber.stop]
        rate = wish.gradient_K_min or 0.0
        orders: list[Callable[[], None]] = [lambda: self._chamber.set_point(set_degC)]
        if self._gradients:  # else the chamber's own stays as it is
            orders.insert(1 if wish.urgent else 0, lambda: self._chamber.gradient(rate, rate))
        return orders


def _agrees(reading: ChamberReading, wish: Wish) -> bool:
    if wish.set_degC is None:
        return not reading.running
    # under a gradient, what the controller is after is still on its way
    return reading.running and (bool(wish.gradient_K_min) or abs(reading.set_degC - wish.set_degC) <= _AGREES_K)
