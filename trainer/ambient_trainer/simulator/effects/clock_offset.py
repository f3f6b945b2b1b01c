"""The reference's clock and the device's disagree, by a little more every hour."""

import numpy as np

from ambient_trainer.data.trace import Array
from ambient_trainer.simulator.device import Device
from ambient_trainer.simulator.hidden import Effect, Figure, Hidden, Ran, Setting

_SKEW = 5e-5  # s per s: a bad crystal


class ClockOffset(Effect):
    """The reference's clock ahead of the device's: what it stamps t happened before t, so its column is late."""

    rank = 11
    unit, low, high = "s", -3600.0, 3600.0
    meaning = "reference's clock less the device's"
    typical = 120.0
    everywhere = since_ever = in_reference = True

    def places(self, device: Device) -> tuple[str, ...]:
        """It has none."""
        return ()

    def air(self, hidden: Hidden, setting: Setting, air_degC: Array, random: np.random.Generator) -> Array:
        """The air of another time; beyond the record's ends as at them."""
        return np.interp(setting.time_s - _ahead_s(hidden, setting, random), setting.time_s, air_degC)

    def magnitude(self, ran: Ran) -> Figure:
        """The mean offset."""
        return float(_ahead_s(ran.hidden, ran.setting, ran.random())[ran.there].mean()), "s", {}


def _ahead_s(hidden: Hidden, setting: Setting, random: np.random.Generator) -> Array:
    """How far the reference's clock is ahead, shape (n,)."""
    skew = random.choice([-1.0, 1.0]) * _SKEW
    middle_s = np.mean(setting.lasting(hidden))
    if not hidden.amount:
        return np.zeros_like(setting.time_s)
    return np.where(setting.lasts(hidden), hidden.amount + skew * (setting.time_s - middle_s), 0.0)


EFFECT = ClockOffset()
