"""Ishii and Nakashima 2017: heat sources from the board's sensors, then the ambient through first-order responses.

Given: a first heat-transfer model gives the temperatures of the heat sources from those of the sensors on the board and
holds nothing of the transient response; a second one gives the surface from the sources and holds the transient
responses from source to sensor and from source to surface. A later patent of the same company takes transfer functions
of a thermal resistance and a time constant each, and estimates the outside air from a reference sensor and one sensor
a component. The thesis says that the ambient came out in the process, and how well is not published.

Filled in: the USB port, far from the processor, is the reference sensor r; sources are processor, camera (whose sensor
is the flash's), battery and display. What is given are rises over r.

1. Steady and linear: a sensor's rise is its own source's and a share of every stronger one's, s - r = H q with H lower
   triangular, ones on its diagonal, by least squares one sensor after the other; the sources are q = H^-1 (s - r).
2. A first-order response from a source to its sensor, K1/(1 + tau1 s), and one to the place that is asked for,
   K2/(1 + tau2 s), make their ratio from the one to the other:

       ambient = offset + sum_i K_i (1 + tau1_i s)/(1 + tau2_i s) q_i,     q_0 = r.

   Every tau2 is searched, every K and tau1 follows from gains that are solved for exactly. Thermal resistances and time
   constants are positive: K is positive for the reference and negative for the sources, whose heat is taken off. Each
   response starts from equilibrium with the first sample.

Sources: M. Ishii, Y. Nakashima, H. Nakao, US patent 10409301 and (first-order responses and the outside air) US patent
10520368, both Fujitsu (their abstracts); section 1.1 of the thesis.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from ambient_model.faults import refuse
from ambient_model.trace import REFERENCE
from ambient_studies.thesis.related._samples import Related, lagged, training_samples
from ambient_trainer.data import Array, Segment, Trace, segments
from ambient_trainer.estimation import Structure, Unknowns, search
from ambient_trainer.lti import StateSpace, response_slopes
from ambient_trainer.lti import lagged as lagged_evenly

SENSORS = ("usb_degC", "soc_degC", "flash_degC", "battery_degC", "display_degC")
"""The reference sensor, then the sources', strongest first."""

_SIGNS = (1, -1, -1, -1, -1)
_LEAST_SAMPLES = 100
_STARTS = 8
_SEED = 0
_FASTEST_PERIODS = 2.0
_TIMES_SHOWN = 10.0


@dataclass(frozen=True)
class TransferFunctions:
    """The two models: ``separation`` (5, 5); of the second, d = K tau1 / tau2, K and tau2 (5,) each, and the offset.

    d rather than tau1 is kept, for K may be 0.
    """

    separation: Array
    direct: Array
    gain: Array
    time_constant_s: Array
    offset_degC: float

    def ambient_degC(self, time_s: Array, rows: Array) -> Array:
        """The estimate, shape (n,), from the sensors (5, n)."""
        sources = self.separation @ rows
        slow = np.vstack([lagged(time_s, source, tau) for source, tau in zip(sources, self.time_constant_s)])
        ambient: Array = self.offset_degC + self.direct @ (sources - slow) + self.gain @ slow
        return ambient


def train(training: Trace) -> TransferFunctions:
    """Both models of one trace; raises :class:`Refused` where the sources cannot be separated."""
    separation = separated(training)
    found = segments(training, SENSORS, (REFERENCE,))
    structure = FirstOrderRatios([replace(each, inputs=separation @ each.inputs) for each in found], _SIGNS)
    with threadpool_limits(1):
        best = search(structure, _STARTS, _SEED).best
    direct, gain = best.beta[:-1].reshape(2, -1)
    return TransferFunctions(separation, direct, gain, np.exp(best.theta), float(best.beta[-1]))


def separated(training: Trace) -> Array:
    """The first model, shape (5, 5): reference and sources' rises from the sensors.

    Least squares of each rise on the stronger sources' is the factor H of rises' rises = H D H'.
    """
    rows = training_samples(training, SENSORS, _LEAST_SAMPLES).rows
    rises = np.eye(len(SENSORS))
    rises[1:, 0] = -1.0
    taken = rises[1:] @ rows
    try:
        root = np.linalg.cholesky(taken @ taken.T / taken.shape[1])
    except np.linalg.LinAlgError:
        problem = f"the rises of {', '.join(SENSORS[1:])} over {SENSORS[0]} are not independent"
        raise refuse(training.path, "", problem, "log a run in which each moves by itself") from None
    H = root / np.diag(root)
    return np.vstack([rises[:1], np.linalg.solve(H, rises[1:])])


class FirstOrderRatios(Structure):
    """The second model over segments of one period: time constants are searched, gains solved for.

        y = offset + sum_i d_i (u_i - L_i u_i) + K_i L_i u_i,    L_i = 1/(1 + tau2_i s),    d_i = K_i tau1_i / tau2_i

    theta is the logarithm of each tau2 in s, beta is d, K, offset; ``signs`` holds +1 or -1 an input, the sign of its K
    and d, which have one sign where every time constant is positive.
    """

    def __init__(self, segments: Sequence[Segment], signs: Sequence[int]) -> None:
        self.segments = segments
        self.inputs = m = segments[0].inputs.shape[0]
        period_s = segments[0].period_s
        longest_s = max(segment.inputs.shape[1] for segment in segments) * period_s
        fastest = math.log(_FASTEST_PERIODS * period_s)
        slowest = max(math.log(longest_s / _TIMES_SHOWN), fastest + 1.0)
        low, high = np.full(m, fastest), np.full(m, slowest)
        self.search = Unknowns(tuple(f"tau{i + 1}" for i in range(m)), (low + high) / 2, low, high)
        names = [f"{gain}{i + 1}" for gain in "dK" for i in range(m)]
        low = np.array([0.0 if sign > 0 else -np.inf for sign in (*signs, *signs)] + [-np.inf])
        high = np.array([np.inf if sign > 0 else 0.0 for sign in (*signs, *signs)] + [np.inf])
        self.linear = Unknowns((*names, "offset"), np.zeros(2 * m + 1), low, high)

    def regressors(self, theta: Array, index: int) -> tuple[Array, Array]:
        """u - L u and L u of each input, and one."""
        u, period_s = self.segments[index].inputs, self.segments[index].period_s
        slow = np.array([lagged_evenly(row, tau_s, period_s) for row, tau_s in zip(u, np.exp(theta).tolist())])
        one = np.ones((1, u.shape[1]))
        return 0 * one, np.concatenate([u - slow, slow, one])[:, None]

    def slopes(self, theta: Array, beta: Array, index: int) -> Array:
        """K - d times the derivative of L in log tau2: 1/tau2 there moves by -1/tau2."""
        segment, m = self.segments[index], self.inputs
        found = []
        for row, rate, gain in zip(segment.inputs, np.exp(-theta), beta[m : 2 * m] - beta[:m]):
            zero, one = np.zeros((1, 1)), np.ones((1, 1))
            lag = StateSpace(-rate * one, rate * one, gain * one, zero, zero[0])
            by = StateSpace(rate * one[None], -rate * one[None], zero[None], zero[None], zero)
            found.append(response_slopes(lag, by, "first-order", row[None], segment.period_s)[0])
        return np.array(found)

    def random_start(self, random: np.random.Generator) -> Array:
        """Time constants drawn log-uniformly between the bounds."""
        return random.uniform(self.search.low, self.search.high)


METHOD = Related(
    "ishii_transfer_functions",
    "Ishii, Nakashima 2017: heat sources by a steady linear model, the ambient through first-order responses. Given: "
    "the two models. Filled in: which sensors, and least squares with positive resistances and time constants",
    SENSORS,
    train,
)
