"""How much of white sensor noise a recursion lets through: output standard deviation per unit of each input's."""

from __future__ import annotations

import math

import numpy as np
from scipy.linalg import solve_discrete_lyapunov

from ambient_trainer.lti.discretise import first_order_hold
from ambient_trainer.lti.statespace import StateSpace


def noise_gain(system: StateSpace, period_s: float) -> float:
    """Of the first output of a stable continuous ``system``, run at ``period_s``."""
    found = first_order_hold(system, period_s)
    covariance = solve_discrete_lyapunov(found.A, found.B @ found.B.T)
    return math.sqrt(float((found.C @ covariance @ found.C.T)[0, 0]) + float(np.sum(found.D[0] ** 2)))
