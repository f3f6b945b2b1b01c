"""Where a run is in its program, and what ends it. No clock and no instrument here: times and temperatures come in.

A step ends when its time is over and all that it waits for has settled. A run that was stopped goes on in the middle of
a step. It ends by air or device beyond a limit, or without an ambient for too long while the chamber works.
"""

import math
from collections.abc import Mapping, Sequence

from ambient_trainer.laboratory.campaign import Safety
from ambient_trainer.laboratory.instruments import AIR
from ambient_trainer.laboratory.messages import StepBegan
from ambient_trainer.simulator.scenario import ScenarioStep, Settle


class SteadyState:
    """Whether the ambient stays at the set point, or without one where it is, and zones where they are, long enough."""

    def __init__(self, settle: Settle, set_degC: float | None) -> None:
        self._settle, self._set_degC = settle, set_degC
        self._near_degC = math.nan if set_degC is None else set_degC
        self._since_s: float | None = None
        self._zones: Mapping[str, float] = {}

    def update(self, now_s: float, ambient_degC: float | None, zones: Mapping[str, float]) -> None:
        """Take in the temperatures at ``now_s``; without an ambient nothing is settled."""
        lacking = ambient_degC is None or (self._settle.drift_K is not None and not zones)
        near = ambient_degC is not None and abs(ambient_degC - self._near_degC) <= self._settle.within_K
        # a zone without a reading may drift
        most_K = math.inf if self._settle.drift_K is None else self._settle.drift_K
        drifted = any(abs(zones.get(name, math.inf) - before) > most_K for name, before in self._zones.items())
        if lacking or not (near or self._set_degC is None):
            self._since_s = None
        elif not near or self._since_s is None or drifted:
            self._since_s, self._zones = now_s, dict(zones)
            if self._set_degC is None and ambient_degC is not None:
                self._near_degC = ambient_degC

    def reached(self, now_s: float) -> bool:
        """Whether all has been steady for as long as asked."""
        return self._since_s is not None and now_s - self._since_s >= 60.0 * self._settle.for_min


class Program:
    """The position in ``steps``; it starts ``elapsed_s`` into step ``step``."""

    def __init__(self, steps: Sequence[ScenarioStep], now_s: float, step: int = 0, elapsed_s: float = 0.0) -> None:
        self.steps = tuple(steps)
        self._begin(step, now_s - elapsed_s)

    @property
    def over(self) -> bool:
        """Whether all steps have been."""
        return self.step >= len(self.steps)

    @property
    def now(self) -> ScenarioStep:
        """The step."""
        return self.steps[min(self.step, len(self.steps) - 1)]

    def update(self, now_s: float, ambient_degC: float | None, zones: Mapping[str, float]) -> None:
        """Take in the newest temperatures."""
        if self._steady is not None:
            self._steady.update(now_s, ambient_degC, zones)

    def advance(self, now_s: float) -> list[tuple[StepBegan, bool]]:
        """The steps (at the end, their number) that began since the last call, and if the one before was unsettled."""
        reached: list[tuple[StepBegan, bool]] = []
        while not self.over and (end := self._end(now_s)) is not None:
            began_s, unsettled = end
            self._begin(self.step + 1, began_s)
            reached.append((StepBegan(self.began_s, self.step, 0.0), unsettled))
        return reached

    def _end(self, now_s: float) -> tuple[float, bool] | None:
        """When the step ended, and whether unsettled; None where it lasts."""
        step = self.now
        least_s = self.began_s + 60.0 * (step.duration_min or 0.0)
        if now_s < least_s:
            return None
        if step.settle is None or self._steady is None:
            return least_s, False  # the next one begins when this should have ended: no delay adds up
        reached, given_up = self._steady.reached(now_s), now_s - self.began_s >= 60.0 * step.settle.at_most_min
        return (now_s, not reached) if reached or given_up else None

    def _begin(self, step: int, began_s: float) -> None:
        self.step, self.began_s = step, began_s
        settle = None if self.over else self.now.settle
        self._steady = SteadyState(settle, self.now.chamber_degC) if settle else None


class SafetyLimits:
    """The limits of a laboratory, from ``now_s`` on."""

    def __init__(self, safety: Safety, now_s: float) -> None:
        self._safety, self._ambient_s = safety, now_s
        self._crossed: str | None = None

    def check_ambient(self, now_s: float, ambient_degC: float | None) -> None:
        """Compare the mean of the probes; None where too few answered."""
        if ambient_degC is not None:
            self._ambient_s = now_s
            self._check_air("ambient", ambient_degC)

    def check(self, values: Mapping[str, float | None]) -> None:
        """Compare what the chamber or the device reads, by column."""
        if (air_degC := values.get(AIR)) is not None:
            self._check_air("chamber", air_degC)
        for column, high_degC in self._safety.device_high_degC.items():
            value = values.get(column)
            if value is not None and value > high_degC:
                self._crossed = f"device: {column} is {value:g}, above its limit of {high_degC:g} degC"

    def violation(self, now_s: float) -> str | None:
        """Why the run has to end, or None; a limit that was crossed once stays crossed."""
        silent_s = now_s - self._ambient_s
        if self._crossed is None and silent_s > self._safety.ambient_lost_s:
            return f"ambient: no probe answered for {silent_s:.0f} s"
        return self._crossed

    def _check_air(self, what: str, temp_degC: float) -> None:
        if (limits := self._safety.chamber) is None:
            return
        for name, limit_degC, sign in (("above", limits.high_degC, 1.0), ("below", limits.low_degC, -1.0)):
            if sign * (temp_degC - limit_degC) > limits.margin_K:
                self._crossed = f"{what}: {temp_degC:.1f} degC is {name} the limit of {limit_degC:g} degC"
