"""Linear time-invariant systems: discretisation, lags, responses, balanced truncation."""

from ambient_trainer.lti.discretise import discretised, first_order_hold, zero_order_hold
from ambient_trainer.lti.lag import lag_weights, lagged
from ambient_trainer.lti.modes import one_pole
from ambient_trainer.lti.reduce import reduced
from ambient_trainer.lti.response import response_degC, response_slopes
from ambient_trainer.lti.statespace import Hold, StateSpace, dc_gain, equilibrium

__all__ = [
    "Hold",
    "StateSpace",
    "dc_gain",
    "discretised",
    "equilibrium",
    "first_order_hold",
    "lag_weights",
    "lagged",
    "one_pole",
    "reduced",
    "response_degC",
    "response_slopes",
    "zero_order_hold",
]
