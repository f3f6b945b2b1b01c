"""The governor's law: a cap on the SoC's power that holds the skin at its target, for whatever ambient it is told.

With the ambient T, the skin's temperature S as a filter of one internal sensor and T, and the skin's rise R per W with
its time constant tau,

    P = (target - T) / R + k (target - S) + I,    k = (4 - 1) / R,    dI/dt = k / tau (target - S) where P binds,

the budget that this ambient leaves, more while the skin is still cool (alone it would make the loop four times as fast
as the phone), and what the budget is wrong by. Only the ambient differs between who knows it and who does not.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ambient_trainer.lti import Hold, StateSpace, dc_gain, discretised

Array = NDArray[np.float64]

SPEED = 4.0
"""How many times faster than the phone itself its skin would settle without the integral; chosen."""
FLOOR_W = 0.5
"""What is always left: a phone that answers; chosen."""
_BINDS = 0.95
"""A cap binds where the SoC draws this share of it."""


@dataclass(frozen=True)
class Identified:
    """What a training run tells of a phone: all that the governor knows of it."""

    sensor: str
    skin: StateSpace
    """The skin in degC from (the sensor in degC, the ambient in degC), continuous."""
    hold: Hold
    rmse_degC: float
    """Of the skin, on the training run."""
    margin_K: float
    """The skin was at most this much hotter than predicted in 95 % of the training run."""
    resistance_K_W: float
    """The skin's rise over the ambient per W that the SoC draws, at rest."""
    time_constant_s: float
    """Of that rise."""

    @property
    def rest_gains(self) -> tuple[float, float]:
        """The skin's change at rest per K of the sensor, and per K of the ambient."""
        sensor, ambient = dc_gain(self.skin)[0].tolist()
        return sensor, ambient

    def trip_degC(self, limit_degC: float, ambient_degC: float) -> float:
        """Where the sensor settles under a governor that assumes an ambient: the fixed trip that this amounts to."""
        sensor, ambient = self.rest_gains
        offset = float(self.skin.offset[0])
        return (limit_degC - self.margin_K - offset - ambient * ambient_degC) / sensor

    def __str__(self) -> str:
        sensor, ambient = self.rest_gains
        return (
            f"at rest the skin is {sensor:.3f} {self.sensor} {'-' if ambient < 0 else '+'} {abs(ambient):.3f} ambient, "
            f"{self.rmse_degC:.2f} degC off "
            f"(RMSE), and rises by {self.resistance_K_W:.2f} K per W with {self.time_constant_s:.0f} s; "
            f"{self.margin_K:.1f} K are kept to the limit"
        )


class Governor:
    """A batch of governors of one phone, alike but for the ambient each goes by; ``top_W`` is the most that is asked.

    ``assumed_degC``, shape (batch,), is what each goes by while it is told nothing: at once and in full, for its own
    prediction of the skin runs beside the other all the time. One whose own sensor is silent leaves :data:`FLOOR_W`.
    """

    def __init__(
        self, identified: Identified, limit_degC: float, top_W: float, period_s: float, assumed_degC: Array
    ) -> None:
        self.target_degC = limit_degC - identified.margin_K
        self._told_skin = _Skin(identified, period_s)
        self._assumed_skin = _Skin(identified, period_s)
        self._resistance = identified.resistance_K_W
        self._gain = (SPEED - 1.0) / self._resistance
        self._integral = self._gain * period_s / identified.time_constant_s
        self._top_W = top_W
        self._assumed_degC = assumed_degC
        self._sensor_degC = np.full(len(assumed_degC), np.nan)
        self._was_told = np.zeros(len(assumed_degC), dtype=np.bool_)
        self._trim_W = np.zeros(len(assumed_degC))
        self._wanted_W = np.full(len(assumed_degC), np.inf)
        self.ambient_degC = assumed_degC
        """What each went by last."""
        self.skin_degC = np.full(len(assumed_degC), np.nan)
        """What each predicted last."""

    def cap_W(self, sensor_degC: Array, told_degC: Array, drawn_W: Array) -> Array:
        """The caps from now on; ``drawn_W`` was drawn under the last ones. NaN: a silent sensor, nothing told."""
        told = ~np.isnan(told_degC)
        self.ambient_degC = np.where(told, told_degC, self._assumed_degC)
        silent = self._heard(sensor_degC)
        mine = self._told_skin.predicted(self._sensor_degC, self.ambient_degC)
        feared = self._assumed_skin.predicted(self._sensor_degC, self._assumed_degC)
        self.skin_degC = np.where(told, mine, feared)
        headroom_K = self.target_degC - self.skin_degC
        # the trim is the error of one ambient, and says nothing of another
        self._trim_W = np.where(told == self._was_told, self._trim_W, 0.0)
        self._trim_W = self._trim_W + self._bound(drawn_W) * ~silent * self._integral * headroom_K
        self._was_told = told
        budget_W = (self.target_degC - self.ambient_degC) / self._resistance
        wanted_W = budget_W + self._gain * headroom_K + self._trim_W
        self._wanted_W = np.where(silent, np.inf, wanted_W)
        return np.where(silent, FLOOR_W, np.clip(wanted_W, FLOOR_W, self._top_W))

    def _heard(self, sensor_degC: Array) -> NDArray[np.bool_]:
        """Which sensors are silent: their last word stands in, and before it the ambient."""
        silent = np.isnan(sensor_degC)
        last = np.where(np.isnan(self._sensor_degC), self.ambient_degC, self._sensor_degC)
        self._sensor_degC = np.where(silent, last, sensor_degC)
        return silent

    def _bound(self, drawn_W: Array) -> NDArray[np.bool_]:
        """Where the last cap was the law's own and held the SoC back."""
        own = (self._wanted_W > FLOOR_W) & (self._wanted_W < self._top_W)
        return own & (drawn_W >= _BINDS * self._wanted_W)


class _Skin:
    """The skin as a filter of sensor and ambient, for a batch, from equilibrium with its first inputs on."""

    def __init__(self, identified: Identified, period_s: float) -> None:
        self._filter = discretised(identified.skin, period_s, identified.hold)
        self._start = -np.linalg.solve(identified.skin.A, identified.skin.B)
        self._state: Array | None = None

    def predicted(self, sensor_degC: Array, ambient_degC: Array) -> Array:
        """The skin now, and one step on."""
        inputs = np.stack([sensor_degC, ambient_degC])
        state = self._start @ inputs if self._state is None else self._state
        self._state = self._filter.A @ state + self._filter.B @ inputs
        predicted: Array = (self._filter.C @ state + self._filter.D @ inputs)[0] + self._filter.offset[0]
        return predicted
