"""What ends a run: air or device beyond a limit, or no ambient for too long while the chamber works.

No clock and no instrument here: samples and times come in. The chamber is sent to its safe set point before the reason
is shown.
"""

from __future__ import annotations

from collections.abc import Mapping

from ambient_trainer.laboratory.campaign import Safety
from ambient_trainer.laboratory.instruments import AIR


class SafetyLimits:
    """The limits of a laboratory, from ``now_s`` on."""

    def __init__(self, safety: Safety, now_s: float) -> None:
        self._safety = safety
        self._ambient_s = now_s
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
        limits = self._safety.chamber
        if temp_degC > limits.high_degC + limits.margin_K:
            self._crossed = f"{what}: {temp_degC:.1f} degC is above the limit of {limits.high_degC:g} degC"
        elif temp_degC < limits.low_degC - limits.margin_K:
            self._crossed = f"{what}: {temp_degC:.1f} degC is below the limit of {limits.low_degC:g} degC"
