"""The governor's law: a cap on the SoC's power that holds the skin at its target, for the ambient that it uses.

With the ambient T, the skin's temperature S as a filter of one internal sensor and T, and the skin's rise R per W with
its time constant tau,

    P = (target - T) / R + k (target - S) + I,    k = (4 - 1) / R,    dI/dt = k / tau (target - S) where P binds,

the steady-state budget at this ambient, a proportional term (alone it makes the loop four times as fast as the phone)
and an integral term for the budget's error. The governors of a comparison differ in their ambient only.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ambient_trainer.data import Array
from ambient_trainer.lti import Hold, StateSpace, dc_gain, discretised

SPEED = 4.0
"""How many times faster than the phone itself its skin would settle without the integral; chosen."""
FLOOR_W = 0.5
"""The lowest cap: the phone still responds; chosen."""
_BINDS = 0.95
"""A cap binds where the SoC draws this share of it."""


@dataclass(frozen=True)
class Identified:
    """What a governor knows of a phone, identified on a training run."""

    sensor: str
    skin: StateSpace
    """The skin in degC from (the sensor in degC, the ambient in degC), continuous."""
    hold: Hold
    rmse_degC: float
    """Of the skin, on the training run."""
    margin_K: float
    """The skin was at most this much hotter than predicted in 95 % of the training run."""
    resistance_K_W: float
    """The skin's rise over the ambient per W that the SoC draws, in steady state."""
    time_constant_s: float
    """Of that rise."""

    @property
    def dc_gains(self) -> tuple[float, float]:
        """The DC gains of the skin from the sensor and from the ambient."""
        sensor, ambient = dc_gain(self.skin)[0].tolist()
        return sensor, ambient

    def trip_degC(self, limit_degC: float, ambient_degC: float) -> float:
        """The sensor's steady state under a governor that assumes an ambient: the equivalent fixed trip point."""
        sensor, ambient = self.dc_gains
        offset = float(self.skin.offset[0])
        return (limit_degC - self.margin_K - offset - ambient * ambient_degC) / sensor

    def __str__(self) -> str:
        sensor, ambient = self.dc_gains
        return (
            f"in steady state the skin is {sensor:.3f} {self.sensor} {'-' if ambient < 0 else '+'} {abs(ambient):.3f} "
            f"ambient (RMSE {self.rmse_degC:.2f} degC), and rises by {self.resistance_K_W:.2f} K per W with "
            f"{self.time_constant_s:.0f} s; "
            f"the margin to the limit is {self.margin_K:.1f} K"
        )


class Governor:
    """A batch of governors of one phone that differ in the ambient they use; ``top_W`` is the highest demand.

    ``assumed_degC``, shape (batch,), replaces a missing ambient without a transient: a second prediction of the skin
    always runs on it. Without a reading of its sensor a governor sets the cap to :data:`FLOOR_W`.
    """

    def __init__(
        self, identified: Identified, limit_degC: float, top_W: float, period_s: float, assumed_degC: Array
    ) -> None:
        self.target_degC = limit_degC - identified.margin_K
        self._known_skin = _Skin(identified, period_s)
        self._assumed_skin = _Skin(identified, period_s)
        self._resistance = identified.resistance_K_W
        self._gain = (SPEED - 1.0) / self._resistance
        self._integral_gain = self._gain * period_s / identified.time_constant_s
        self._top_W = top_W
        self._assumed_degC = assumed_degC
        self._sensor_degC = np.full(len(assumed_degC), np.nan)
        self._was_known = np.zeros(len(assumed_degC), dtype=np.bool_)
        self._integral_W = np.zeros(len(assumed_degC))
        self._wanted_W = np.full(len(assumed_degC), np.inf)
        self.ambient_degC = assumed_degC
        """The ambient that each used last."""
        self.skin_degC = np.full(len(assumed_degC), np.nan)
        """The skin that each predicted last."""

    def cap_W(self, sensor_degC: Array, known_degC: Array, drawn_W: Array) -> Array:
        """The next caps; ``drawn_W`` was drawn under the last ones. NaN: no reading of the sensor, no known ambient."""
        known = ~np.isnan(known_degC)
        self.ambient_degC = np.where(known, known_degC, self._assumed_degC)
        silent = np.isnan(sensor_degC)
        # in the place of a missing reading its last one, before the first one the ambient
        last = np.where(np.isnan(self._sensor_degC), self.ambient_degC, self._sensor_degC)
        self._sensor_degC = np.where(silent, last, sensor_degC)
        on_known = self._known_skin.predicted(self._sensor_degC, self.ambient_degC)
        on_assumed = self._assumed_skin.predicted(self._sensor_degC, self._assumed_degC)
        self.skin_degC = np.where(known, on_known, on_assumed)
        headroom_K = self.target_degC - self.skin_degC
        # the integral belongs to one ambient
        self._integral_W = np.where(known == self._was_known, self._integral_W, 0.0)
        self._integral_W = self._integral_W + self._limited(drawn_W) * ~silent * self._integral_gain * headroom_K
        self._was_known = known
        budget_W = (self.target_degC - self.ambient_degC) / self._resistance
        wanted_W = budget_W + self._gain * headroom_K + self._integral_W
        self._wanted_W = np.where(silent, np.inf, wanted_W)
        return np.where(silent, FLOOR_W, np.clip(wanted_W, FLOOR_W, self._top_W))

    def _limited(self, drawn_W: Array) -> NDArray[np.bool_]:
        """Where the last cap lay between floor and top and limited the SoC."""
        own = (self._wanted_W > FLOOR_W) & (self._wanted_W < self._top_W)
        return own & (drawn_W >= _BINDS * self._wanted_W)


class _Skin:
    """The skin as a filter of sensor and ambient, for a batch; starts in equilibrium with its first inputs."""

    def __init__(self, identified: Identified, period_s: float) -> None:
        self._filter = discretised(identified.skin, period_s, identified.hold)
        self._start = -np.linalg.solve(identified.skin.A, identified.skin.B)
        self._state: Array | None = None

    def predicted(self, sensor_degC: Array, ambient_degC: Array) -> Array:
        """The skin now; advances the state by one step."""
        inputs = np.stack([sensor_degC, ambient_degC])
        state = self._start @ inputs if self._state is None else self._state
        self._state = self._filter.A @ state + self._filter.B @ inputs
        predicted: Array = (self._filter.C @ state + self._filter.D @ inputs)[0] + self._filter.offset[0]
        return predicted
