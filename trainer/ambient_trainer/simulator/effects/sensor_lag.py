"""A sensor's delay: two lags, one behind the other, as through grease and a housing."""

import numpy as np

from ambient_trainer.data.trace import Array
from ambient_trainer.lti.lag import lagged
from ambient_trainer.simulator.hidden import Hidden, SensorEffect, Setting

_LAGS = (0.7, 0.3)  # shares of the delay


class SensorLag(SensorEffect):
    """A mean delay."""

    rank = 8
    unit, low, high = "s", 0.0, 3600.0
    meaning = "mean delay"
    typical = 150.0

    def felt(self, hidden: Hidden, setting: Setting, felt_degC: Array, random: np.random.Generator) -> Array:
        """Late."""
        late = felt_degC
        for share in _LAGS if hidden.amount else ():
            late = lagged(late, share * hidden.amount, setting.period_s)
        return felt_degC + setting.share(hidden) * (late - felt_degC)


EFFECT = SensorLag()
