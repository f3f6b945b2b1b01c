"""A sensor drifts: slowly at first, then faster."""

import numpy as np

from ambient_trainer.data.trace import Array
from ambient_trainer.simulator.hidden import Figure, Hidden, Ran, SensorEffect, Setting, slope

_POWER = 1.15  # of the time since it began


class SensorDrift(SensorEffect):
    """An error that grows."""

    rank = 10
    unit, low, high = "K/h", -60.0, 60.0
    meaning = "rate"
    typical = 1.0
    for_good = True

    def felt(self, hidden: Hidden, setting: Setting, felt_degC: Array, random: np.random.Generator) -> Array:
        """Off by more and more while it lasts."""
        return felt_degC + hidden.amount * np.where(setting.lasts(hidden), _drifted_h(hidden, setting), 0.0)

    def magnitude(self, ran: Ran) -> Figure:
        """The rate by least squares."""
        drifted_K = ran.hidden.amount * _drifted_h(ran.hidden, ran.setting)[ran.there]
        since_h = (ran.setting.time_s[ran.there] - ran.setting.lasting(ran.hidden)[0]) / 3600.0
        return slope(drifted_K, since_h), "K/h", {"at_the_end_K": (float(drifted_K[-1]), "K")}


def _drifted_h(hidden: Hidden, setting: Setting) -> Array:
    """How long a sensor drifts, in h, bent, shape (n,)."""
    start_s, end_s = setting.lasting(hidden)
    passed_s = np.clip(setting.time_s - start_s, 0.0, end_s - start_s)
    return (passed_s / (end_s - start_s)) ** _POWER * (end_s - start_s) / 3600.0


EFFECT = SensorDrift()
