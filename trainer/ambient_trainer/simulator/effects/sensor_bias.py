"""A sensor's constant error, which comes within a minute and a half."""

import numpy as np

from ambient_trainer.data.trace import Array
from ambient_trainer.simulator.hidden import Figure, Hidden, Ran, SensorEffect, Setting

_SLEW_S = 90.0


class SensorBias(SensorEffect):
    """An offset of the sensor."""

    rank = 6
    unit, low, high = "degC", -50.0, 50.0
    meaning = "what is added to the reading"
    typical = 2.0

    def felt(self, hidden: Hidden, setting: Setting, felt_degC: Array, random: np.random.Generator) -> Array:
        """Shifted."""
        return felt_degC + hidden.amount * setting.share(hidden, _SLEW_S)

    def magnitude(self, ran: Ran) -> Figure:
        """Its mean while it is there."""
        return float(ran.hidden.amount * ran.setting.share(ran.hidden, _SLEW_S)[ran.there].mean()), "degC", {}


EFFECT = SensorBias()
