"""A sensor's delay: two lags, one behind the other, as through grease and a housing."""

from ambient_trainer.data.trace import Array
from ambient_trainer.lti.lag import lagged
from ambient_trainer.simulator.hidden import Acting, Effect

_LAGS = (0.7, 0.3)  # shares of the delay


class SensorLag(Effect):
    """A mean delay."""

    rank = 8
    unit, low, high = "s", 0.0, 3600.0
    meaning = "mean delay"
    typical = 150.0
    at = "sensors"

    def felt(self, acting: Acting, felt_degC: Array) -> Array:
        late, delay_s = felt_degC, acting.hidden.amount
        for share in _LAGS if delay_s else ():
            late = lagged(late, share * delay_s, acting.period_s)
        return felt_degC + acting.share() * (late - felt_degC)


EFFECT = SensorLag()
