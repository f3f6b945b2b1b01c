"""A sensor's wrong slope, which is a little bent."""

import numpy as np

from ambient_trainer.data.trace import Array
from ambient_trainer.simulator.hidden import Figure, Hidden, Ran, SensorEffect, Setting

_REFERENCE_DEGC = 25.0
_BENT_PER_K = 1e-3  # the gain's own change


class SensorGain(SensorEffect):
    """An error of the slope about 25 degC."""

    rank = 7
    low, high = -0.9, 9.0
    meaning = "relative error of the slope"
    typical = 0.12

    def felt(self, hidden: Hidden, setting: Setting, felt_degC: Array, random: np.random.Generator) -> Array:
        """Turned about the reference."""
        from_reference = felt_degC - _REFERENCE_DEGC
        bent = hidden.amount * from_reference * (1.0 + _BENT_PER_K * from_reference)
        return felt_degC + setting.share(hidden) * bent

    def magnitude(self, ran: Ran) -> Figure:
        """The slope's error at the reference."""
        return ran.hidden.amount, "1", {"reference_degC": (_REFERENCE_DEGC, "degC")}


EFFECT = SensorGain()
