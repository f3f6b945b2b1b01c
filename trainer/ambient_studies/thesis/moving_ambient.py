"""What the thesis's balance forgets when the ambient moves (erratum 8): a node stores C dT/dt, not C d(T - T_amb)/dt.

With x = T - T_amb the node's balance is dx/dt = A x + B u - 1 dT_amb/dt, and T_amb is the output y = C x + D u itself.
The nodes' temperatures z = x + 1 y have no derivative of it:

    dz/dt = A (z - 1 y) + B u,    y = C (z - 1 y) + D u.

With k = 1 + C 1 the second gives y = (C z + D u)/k, and the first the explicit system

    dz/dt = (A - A 1 C/k) z + (B - A 1 D/k) u.

Where C are shares of a whole (equations 4.11, 4.22) k is 0: y drops out of its own equation, and what is left takes
the derivative of the sensors. So the term is tried with free C and D (4.29, 4.30). At k <= 0 the loop is unstable.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import least_squares, lsq_linear
from threadpoolctl import threadpool_limits

from ambient_model.trace import REFERENCE
from ambient_trainer.data import Array, Segment, Trace, sampling_period_s, segments
from ambient_trainer.lti import StateSpace, response_degC

INPUTS = ("flash_degC", "battery_degC", "usb_degC", "display_degC")

_EXCHANGES = (("flash", "display"), ("battery", "display"), ("battery", "usb"), ("usb", "battery"))
"""Into a node from another: the rows of figure 4.4's B."""
_NODES = ("flash", "battery", "usb", "display")
_FASTEST_PER_S = 1.0
_SLOWEST_PER_S = 1e-5
_LARGEST_WEIGHT = 20.0
_PERIOD_S = 10.0
_START_PER_S = (0.05, 0.01, 0.002)
_STARTS = tuple((flash, battery, usb) for flash in (0.1, -0.1) for battery in (0.1, -0.1) for usb in (0.1, -0.1))
_DIVERGED_DEGC = 1e3
_SMALLEST_K = 1e-3
_SMALLEST_DECAY_PER_S = 1e-7


def with_moving_ambient(rises: StateSpace) -> StateSpace:
    """The explicit system of circuit ``rises`` (states T - T_amb, output T_amb) with -dT_amb/dt in every balance."""
    loss = rises.A @ np.ones((len(rises.A), 1))
    k = 1 + float(rises.C.sum())
    return replace(rises, A=rises.A - loss @ rises.C / k, B=rises.B - loss @ rises.D / k, C=rises.C / k, D=rises.D / k)


def fit_with_moving_ambient(training: Trace) -> StateSpace:
    """Figure 4.4's circuit with free C and D and the term, fitted to ``training``: continuous, over ``INPUTS``.

    One sample in ten seconds is enough for its time constants. Searched are the loss rates 1/(C R) and C, from every
    combination of signs of C; the exchange rates, which cannot be negative, and D enter linearly and are solved for.
    """
    stretches = segments(training, INPUTS, (REFERENCE,), max(_PERIOD_S, sampling_period_s(training.time_s)))
    reference = np.concatenate([each.outputs[0] for each in stretches])
    bounds = (
        [np.log(_SLOWEST_PER_S)] * 3 + [-_LARGEST_WEIGHT] * 3,
        [np.log(_FASTEST_PER_S)] * 3 + [_LARGEST_WEIGHT] * 3,
    )

    def error_degC(theta: Array) -> Array:
        stable = 1 + theta[3:].sum() >= _SMALLEST_K
        if not stable or np.linalg.eigvals(_closed(theta, np.zeros(8)).A).real.max() >= -_SMALLEST_DECAY_PER_S:
            return np.full(len(reference), _DIVERGED_DEGC)
        responses = _responses(theta, stretches)
        error = reference - _solved(responses, reference) @ responses
        return np.where(np.isnan(error), 0.0, error)

    with threadpool_limits(1):
        ends = [
            least_squares(error_degC, [*np.log(_START_PER_S), *weights], bounds=bounds, max_nfev=40)
            for weights in _STARTS
        ]
        best = min(ends, key=lambda end: float(end.cost)).x
        return _closed(best, _solved(_responses(best, stretches), reference))


def _responses(theta: Array, stretches: Sequence[Segment]) -> Array:
    """The estimate (8, N) from each unit of the linear gains, over all ``stretches``."""
    systems = [_closed(theta, unit) for unit in np.eye(8)]
    return np.array(
        [
            np.concatenate([response_degC(system, "first-order", each.inputs, each.period_s) for each in stretches])
            for system in systems
        ]
    )


def _closed(theta: Array, gains: Array) -> StateSpace:
    """The explicit system; ``theta`` holds the logarithms of three loss rates and C, ``gains`` four exchanges and D."""
    B = np.zeros((3, 4))
    for rate, (node, other) in zip(gains, _EXCHANGES):
        B[_NODES.index(node), _NODES.index(other)] += rate
        B[_NODES.index(node), _NODES.index(node)] -= rate
    losses, C = np.diag(np.exp(theta[:3])), theta[None, 3:]
    return with_moving_ambient(StateSpace(-losses, B, C, gains[None, 4:], np.zeros(1)))


def _solved(responses: Array, reference: Array) -> Array:
    """The gains by least squares, exchange rates between 0 and 1 per second."""
    known = ~np.isnan(reference)
    # the triangle has the same inner products in nine rows
    R = np.asarray(np.linalg.qr(np.vstack([responses, reference])[:, known].T, mode="r"))
    low, high = np.array([0.0] * 4 + [-np.inf] * 4), np.array([_FASTEST_PER_S] * 4 + [np.inf] * 4)
    free = np.linalg.lstsq(R[:, :-1], R[:, -1], rcond=None)[0]
    if (low <= free).all() and (free <= high).all():
        return np.asarray(free)
    return np.asarray(lsq_linear(R[:, :-1], R[:, -1], (low, high), method="bvls").x)
