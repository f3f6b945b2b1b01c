"""Where a run is in its program: a step ends when its time is over and all that it waits for has settled.

No clock and no instrument here: times and temperatures come in. A run that was stopped goes on in the middle of a step.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from ambient_trainer.simulator.scenario import Settle, Step


class Settling:
    """Whether the ambient stays at the set point, and zones where they are, long enough."""

    def __init__(self, settle: Settle, set_degC: float) -> None:
        self._settle = settle
        self._set_degC = set_degC
        self._since_s: float | None = None
        self._zones: Mapping[str, float] = {}

    def hear(self, now_s: float, ambient_degC: float | None, zones: Mapping[str, float]) -> None:
        """Take in what is so at ``now_s``; a missing ambient settles nothing."""
        unheard = self._settle.drift_K is not None and not zones
        if ambient_degC is None or abs(ambient_degC - self._set_degC) > self._settle.within_K or unheard:
            self._since_s = None
        elif self._since_s is None or self._moved(zones):
            self._since_s, self._zones = now_s, dict(zones)

    def over(self, now_s: float) -> bool:
        """Whether all has been at rest for as long as asked."""
        return self._since_s is not None and now_s - self._since_s >= 60.0 * self._settle.for_min

    def _moved(self, zones: Mapping[str, float]) -> bool:
        drift_K = self._settle.drift_K
        if drift_K is None:
            return False
        if not zones.keys() >= self._zones.keys():  # a zone that is not heard may move
            return True
        return any(abs(zones[name] - before) > drift_K for name, before in self._zones.items())


class Reached(NamedTuple):
    """A step has begun."""

    step: int
    """Of the program; its length at the end."""
    at_s: float
    unsettled: bool
    """The one before it gave up waiting."""


class Program:
    """The position in ``steps``; it starts ``elapsed_s`` into step ``step``."""

    def __init__(self, steps: Sequence[Step], now_s: float, step: int = 0, elapsed_s: float = 0.0) -> None:
        self.steps = tuple(steps)
        self.step = step
        self.began_s = now_s - elapsed_s
        self._settling = self._settling_now()

    @property
    def over(self) -> bool:
        """Whether all steps have been."""
        return self.step >= len(self.steps)

    @property
    def now(self) -> Step:
        """The step."""
        return self.steps[min(self.step, len(self.steps) - 1)]

    def hear(self, now_s: float, ambient_degC: float | None, zones: Mapping[str, float]) -> None:
        """Take in the newest temperatures."""
        if self._settling is not None:
            self._settling.hear(now_s, ambient_degC, zones)

    def advance(self, now_s: float) -> list[Reached]:
        """The steps that have begun since the last call."""
        reached: list[Reached] = []
        while not self.over and (end := self._end(now_s)) is not None:
            self.step += 1
            self.began_s, unsettled = end
            self._settling = self._settling_now()
            reached.append(Reached(self.step, self.began_s, unsettled))
        return reached

    def _end(self, now_s: float) -> tuple[float, bool] | None:
        """When the step ended, and whether unsettled; None where it lasts."""
        step = self.now
        least_s = self.began_s + 60.0 * (step.duration_min or 0.0)
        if now_s < least_s:
            return None
        if step.settle is None or self._settling is None:
            return least_s, False  # the next one begins when this should have ended: no delay adds up
        if self._settling.over(now_s):
            return now_s, False
        given_up = now_s - self.began_s >= 60.0 * step.settle.at_most_min
        return (now_s, True) if given_up else None

    def _settling_now(self) -> Settling | None:
        if self.over or self.now.settle is None:
            return None
        return Settling(self.now.settle, self.now.chamber_degC)
