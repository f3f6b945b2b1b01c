"""A sensor drifts: slowly at first, then faster."""

import numpy as np

from ambient_trainer.data.trace import Array
from ambient_trainer.simulator.hidden import Acting, Effect, Figure, Ran, slope

_POWER = 1.15  # of the time since it began


class SensorDrift(Effect):
    """An error that grows."""

    rank = 10
    unit, low, high = "K/h", -60.0, 60.0
    meaning = "rate"
    typical = 1.0
    at, for_good = "sensors", True

    def felt(self, acting: Acting, felt_degC: Array) -> Array:
        return felt_degC + np.where(acting.lasts, _drifted_K(acting), 0.0)

    def magnitude(self, ran: Ran) -> Figure:
        drifted_K = _drifted_K(ran)[ran.there]
        since_h = (ran.time_s[ran.there] - ran.lasting[0]) / 3600.0
        return slope(drifted_K, since_h), "K/h", {"at_the_end_K": (float(drifted_K[-1]), "K")}


def _drifted_K(acting: Acting) -> Array:
    """How far a sensor has drifted: its rate times the hours, which are bent, shape (n,)."""
    start_s, end_s = acting.lasting
    passed_s = np.clip(acting.time_s - start_s, 0.0, end_s - start_s)
    return acting.hidden.amount * ((passed_s / (end_s - start_s)) ** _POWER * (end_s - start_s) / 3600.0)


EFFECT = SensorDrift()
