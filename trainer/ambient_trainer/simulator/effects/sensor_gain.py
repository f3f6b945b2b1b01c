"""A sensor's wrong slope, which is a little bent."""

from ambient_trainer.data.trace import Array
from ambient_trainer.simulator.hidden import Acting, Effect, Figure, Ran

_REFERENCE_DEGC = 25.0
_BENT_PER_K = 1e-3  # the gain's own change


class SensorGain(Effect):
    """An error of the slope about 25 degC."""

    rank = 7
    low, high = -0.9, 9.0
    meaning = "relative error of the slope"
    typical = 0.12
    at = "sensors"

    def felt(self, acting: Acting, felt_degC: Array) -> Array:
        from_reference = felt_degC - _REFERENCE_DEGC
        bent = acting.hidden.amount * from_reference * (1.0 + _BENT_PER_K * from_reference)
        return felt_degC + acting.share() * bent

    def magnitude(self, ran: Ran) -> Figure:
        """The slope's error at the reference."""
        return ran.hidden.amount, "1", {"reference_degC": (_REFERENCE_DEGC, "degC")}


EFFECT = SensorGain()
