"""Linear time-invariant systems: discretisation, lags, responses, balanced truncation."""

from ambient_trainer.lti.discretise import discretised, discretised_slopes
from ambient_trainer.lti.lag import lag_weights, lagged, low_pass
from ambient_trainer.lti.response import noise_gain, response_degC, response_slopes, states
from ambient_trainer.lti.statespace import Hold, StateSpace, dc_gain, equilibrium, passive_modes, reduced
