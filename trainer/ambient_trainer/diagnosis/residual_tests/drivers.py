"""What a residual may go along with: a course over time, at once or with the delay of a body that it has to warm."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

Array = NDArray[np.float64]

_DELAYS_STEPS = (0.0, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0)
_LONGEST_DELAY_FRAC = 0.25
_RATE_STEPS = 5


@dataclass(frozen=True)
class Driver:
    """A course (n,) under every delay: ``responses`` (delays, n) are first-order responses with ``delays_steps``.

    ``given`` is another driver's responses, of the same shape, whose part in the residual is taken out before.
    """

    test: str
    name: str
    responses: Array
    delays_steps: tuple[float, ...]
    given: Array | None = None


def signal_drivers(signals: Mapping[str, Array]) -> list[Driver]:
    """A driver for each signal (n,) that changes."""
    return [_driver("cross-correlation", name, values) for name, values in signals.items() if np.ptp(values) > 0]


def ambient_drivers(ambient_degC: Array, simulated_degC: Array) -> list[Driver]:
    """The node's difference to the ambient and the ambient's rate, both (n,), each straight and curved.

    The difference is the simulated node's: the measured one's noise is also in the residual.
    """
    rate = np.gradient(_smooth(ambient_degC, _RATE_STEPS))
    return [
        *_straight_and_curved("ambient difference", simulated_degC - ambient_degC),
        *_straight_and_curved("ambient rate", rate),
    ]


def drift_driver(samples: int) -> Driver:
    """Time itself."""
    course = np.linspace(-0.5, 0.5, samples)
    return Driver("drift", "", course[None], (0.0,))


def _straight_and_curved(test: str, course: Array) -> list[Driver]:
    if np.ptp(course) < 1e-9:
        return []
    straight = _driver(test, "", course)
    bent = (course - course.mean()) ** 2
    centred = course - course.mean()
    curved = _driver(f"{test}, curved", "", bent - centred * (bent @ centred) / (centred @ centred))
    return [straight, Driver(curved.test, "", curved.responses, curved.delays_steps, straight.responses)]


def _driver(test: str, name: str, course: Array) -> Driver:
    delays = tuple(each for each in _DELAYS_STEPS if each <= _LONGEST_DELAY_FRAC * len(course))
    return Driver(test, name, np.stack([_response(course, each) for each in delays]), delays)


def _response(course: Array, delay_steps: float) -> Array:
    """What a body that follows with ``delay_steps`` makes of ``course``, from equilibrium at its start."""
    if delay_steps == 0:
        return course
    kept = np.exp(-1 / delay_steps)
    response, _ = lfilter([1 - kept], [1, -kept], course, zi=[kept * course[0]])
    return np.asarray(response)


def _smooth(values: Array, steps: int) -> Array:
    padded = np.pad(values, steps // 2, mode="edge")
    return np.convolve(padded, np.full(steps, 1 / steps), mode="valid")
