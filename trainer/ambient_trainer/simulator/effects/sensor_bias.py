"""A sensor's constant error, which comes within a minute and a half."""

from ambient_trainer.data.trace import Array
from ambient_trainer.simulator.hidden import Acting, Effect, Figure, Ran

_SLEW_S = 90.0


class SensorBias(Effect):
    """An offset of the sensor."""

    rank = 6
    unit, low, high = "degC", -50.0, 50.0
    meaning = "what is added to the reading"
    typical = 2.0
    at = "sensors"

    def felt(self, acting: Acting, felt_degC: Array) -> Array:
        return felt_degC + acting.hidden.amount * acting.share(_SLEW_S)

    def magnitude(self, ran: Ran) -> Figure:
        return float(ran.hidden.amount * ran.share(_SLEW_S)[ran.there].mean()), "degC", {}


EFFECT = SensorBias()
