"""The reference's clock and the device's disagree, by a little more every hour."""

import numpy as np

from ambient_trainer.data.trace import Array
from ambient_trainer.simulator.device import Device
from ambient_trainer.simulator.hidden import Acting, Effect, Figure, Ran

_SKEW = 5e-5  # s per s: a bad crystal


class ClockOffset(Effect):
    """The reference's clock ahead of the device's: what it stamps t happened before t, so its column is late."""

    rank = 11
    unit, low, high = "s", -3600.0, 3600.0
    meaning = "reference's clock less the device's"
    typical = 120.0
    everywhere = since_ever = in_reference = True

    def places(self, device: Device) -> tuple[str, ...]:
        return ()

    def air(self, acting: Acting, air_degC: Array) -> Array:
        """The air of another time; beyond the record's ends as at them."""
        return np.interp(acting.time_s - _ahead_s(acting), acting.time_s, air_degC)

    def magnitude(self, ran: Ran) -> Figure:
        return float(_ahead_s(ran)[ran.there].mean()), "s", {}


def _ahead_s(acting: Acting) -> Array:
    """How far the reference's clock is ahead, shape (n,)."""
    offset_s, middle_s = acting.hidden.amount, np.mean(acting.lasting)
    skew = acting.random().choice([-1.0, 1.0]) * _SKEW
    return np.where(acting.lasts & (offset_s != 0.0), offset_s + skew * (acting.time_s - middle_s), 0.0)


EFFECT = ClockOffset()
