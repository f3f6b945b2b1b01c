"""Where a chamber's set point is refused: outside the campaign's limits nothing is sent."""

from __future__ import annotations

from typing import NamedTuple

from ambient_model.faults import refuse

STEEPEST_K_MIN = 99.9


class SetPointLimits(NamedTuple):
    """The limits of the chamber at ``port``, in degC; all of its protocols have tenths."""

    port: str
    low_degC: float
    high_degC: float

    def within(self, lowest_degC: float, highest_degC: float) -> SetPointLimits:
        """The limits themselves; raises :class:`Refused` where the chamber itself cannot reach them."""
        if not lowest_degC <= self.low_degC < self.high_degC <= highest_degC:
            problem = f"{self.low_degC:g} to {self.high_degC:g} degC"
            hint = f"name two, the lower first, within {lowest_degC:g} to {highest_degC:g} degC"
            raise refuse("chamber", "limits", problem, hint)
        return self

    def set_point(self, temp_degC: float) -> float:
        """``temp_degC`` in tenths; raises :class:`Refused` outside the limits."""
        rounded_degC = round(temp_degC, 1) + 0.0  # no -0.0
        if not self.low_degC <= min(temp_degC, rounded_degC) <= max(temp_degC, rounded_degC) <= self.high_degC:
            raise refuse(
                f"chamber on {self.port}",
                "set point",
                f"{temp_degC:g} degC is outside its limits, {self.low_degC:g} to {self.high_degC:g} degC",
                "choose another, or other limits; nothing was sent",
            )
        return rounded_degC

    def gradient(self, rate_K_min: float) -> float:
        """``rate_K_min`` in tenths, 0 for none; raises :class:`Refused` for what a chamber does not take."""
        rounded_K_min = round(rate_K_min, 1) if 0.0 <= rate_K_min <= STEEPEST_K_MIN else 0.0
        if rounded_K_min == 0.0 and rate_K_min != 0.0:
            hint = f"choose 0.1 to {STEEPEST_K_MIN:g} K/min, or 0 for none; nothing was sent"
            raise refuse(f"chamber on {self.port}", "gradient", f"{rate_K_min:g} K/min", hint)
        return rounded_K_min
