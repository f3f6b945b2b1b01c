"""Estimates from sensor samples at any times: the rule for gaps, missing inputs and starts. It knows no clock.

The recursion runs on whole periods. A sample that comes n periods after the last complete one is reached in n exact
steps along the straight line between the two. A gap, or an input that stays away, is bridged so for at most
:func:`bridge_limit_s`; beyond it the estimate is no longer trusted and starts again from equilibrium. Where another
limit is asked for missing inputs, ``coast_s``, a longer one lengthens the bridge, too, and after a shorter one the
bridge stands, but there is no estimate.
"""

import itertools
import math
from collections.abc import Sequence
from typing import NamedTuple

from ambient_model.model import Discrete, Estimator
from ambient_model.recursion import advance, equilibrium, output, settling_steps

WARMING_UP = "warming_up"
TRACKING = "tracking"
DEGRADED = "degraded"
COASTING = "coasting"
FAULTED = "faulted"

_SETTLED = 0.05

Readings = Sequence[float | None]


class Estimate(NamedTuple):
    """The estimate of the ambient at one time."""

    ambient_degC: float | None
    low_degC: float | None
    high_degC: float | None
    status: str
    used: tuple[float | None, ...]
    """Each input as the recursion took it."""


class Snapshot(NamedTuple):
    """State of a tracker, for another of the same estimator: the last moment at which every input was there.

    That moment is ``start_s`` + ``step`` * ``period_s`` on the clock of the samples.
    """

    period_s: float
    start_s: float
    step: int
    x: tuple[float, ...]
    u: tuple[float, ...]


class _Away(NamedTuple):
    """Where the recursion has come to since an input went away, and what was read on the way."""

    step: int
    x: list[float]
    u: list[float]
    readings: list[tuple[int, Readings]]
    """Per sample since then its step and its inputs."""


def bridge_limit_s(period_s: float) -> float:
    """How long a gap is bridged: 30 s, or 10 periods where they are longer."""
    return max(30.0, 10.0 * period_s)


def nearest_discrete(estimator: Estimator, period_s: float) -> Discrete:
    """The longest period of the estimator that fits into ``period_s`` a whole number of times, to 10 % of itself.

    Where none does, the shortest one.
    """
    fitting = [
        each
        for each in estimator.discrete
        if abs(period_s / each.period_s - max(1, round(period_s / each.period_s))) <= 0.1
    ]
    return max(fitting, key=_period) if fitting else min(estimator.discrete, key=_period)


def _period(discrete: Discrete) -> float:
    return discrete.period_s


class Tracker:
    """An estimator with its state, fed one sample at a time.

    ``level`` is the interval in percent that is published as low and high; ``coast_s`` is how long an input may stay
    away, :func:`bridge_limit_s` where it is None.
    """

    def __init__(self, estimator: Estimator, discrete: Discrete, level: int = 90, coast_s: float | None = None) -> None:
        self.estimator = estimator
        self.discrete = discrete
        self.error_low_degC, self.error_high_degC = estimator.interval[level]
        self.limit_steps = round(bridge_limit_s(discrete.period_s) / discrete.period_s)
        self._coast_steps = self.limit_steps if coast_s is None else round(coast_s / discrete.period_s)
        self.settling_steps = settling_steps(discrete.A, _SETTLED)
        self._ranges = [(each.min, each.max) for each in estimator.inputs]
        self.start = estimator.initial
        """The state at a start per unit of each input."""
        self.restart()

    def restart(self) -> None:
        """Forget its state: the next complete sample is a start."""
        self._begun = False
        self.last: list[float] = []
        """Each input at the last moment at which all were there."""
        self._x: list[float] = []
        """The state at that moment."""
        self._step = 0
        self._away: _Away | None = None
        self._start_s = 0.0

    @property
    def step(self) -> int:
        """The period that the last estimate is of, counted from the start."""
        return self._step if self._away is None else self._away.step

    def snapshot(self) -> Snapshot | None:
        """Its state, for :meth:`restore`; None where it has not begun."""
        if not self._begun:
            return None
        return Snapshot(self.discrete.period_s, self._start_s, self._step, tuple(self._x), tuple(self.last))

    def fits(self, snapshot: Snapshot) -> bool:
        """Whether ``snapshot`` has this tracker's period and shapes."""
        shape = (self.discrete.period_s, len(self.estimator.states), len(self.estimator.inputs))
        return (snapshot.period_s, len(snapshot.x), len(snapshot.u)) == shape

    def restore(self, snapshot: Snapshot) -> None:
        """Continue from ``snapshot``, which :meth:`fits`, under the same rule for gaps as from a moment of its own."""
        self.restart()
        self._begun = True
        self._start_s, self._step = snapshot.start_s, snapshot.step
        self._x, self.last = list(snapshot.x), list(snapshot.u)

    def update(self, time_s: float, readings: Readings) -> Estimate:
        """The estimate at ``time_s`` from one reading per input (degC, A, ...; None where missing).

        A reading outside its input's range counts as missing. Time that goes back to an earlier period starts again.
        """
        u = [value for value, (low, high) in zip(readings, self._ranges) if value is not None and low <= value <= high]
        if len(u) < len(self._ranges):
            return self._hold(time_s, readings)
        self.follow(time_s, u)
        return self._estimate(TRACKING if self._step >= self.settling_steps else WARMING_UP, self._x, self.last)

    def follow(self, time_s: float, u: list[float]) -> None:
        """:meth:`update` with one reading per input, each in its range, without computing the estimate."""
        step = self._step + 1
        # a sample that comes when the next one is due, with nothing missing before it
        if (
            self._begun
            and self._away is None
            and step <= (time_s - self._start_s) / self.discrete.period_s + 0.5 < step + 1
        ):
            self._x = advance(self.discrete, self._x, self.last)
            self._step, self.last = step, u
        else:
            self._catch_up(time_s, u)

    def _reached(self, time_s: float) -> int | None:
        """The step that ``time_s`` lies at; None where it can't be reached from where the recursion is."""
        steps = (time_s - self._start_s) / self.discrete.period_s + 0.5
        if not self._begun or not self.step <= steps < self.step + self.limit_steps + 1:
            return None
        step = math.floor(steps)
        return step if step - self._step <= max(self._coast_steps, self.limit_steps) else None

    def _catch_up(self, time_s: float, u: list[float]) -> None:
        """Go on from the last moment with all inputs, along straight lines where some were missing; or begin.

        Within the first period a later sample is a better start.
        """
        step = self._reached(time_s)
        if step is None:
            self.restart()
            self._begun = True
            self._start_s = time_s
            step = 0
        if step == 0:
            self._x = equilibrium(self.start, u)
        elif self._away is not None:
            self._x = self._bridge(self._away.readings, step, u)
        else:
            self._x = self._along_line(self._x, self.last, u, step - self._step)
        self._away = None
        self._step, self.last = step, u

    def _hold(self, time_s: float, readings: Readings) -> Estimate:
        """Some input is missing: its last value replaces it, and is trusted for ``coast_s``."""
        inputs = [
            value if value is not None and low <= value <= high else None
            for value, (low, high) in zip(readings, self._ranges)
        ]
        step = self._reached(time_s)
        if step is None:
            self.restart()
            return _nothing(inputs)
        before = self._away or _Away(self._step, self._x, self.last, [])
        u = [value if value is not None else last for value, last in zip(inputs, before.u)]
        x = self._along_line(before.x, before.u, u, step - before.step)
        before.readings.append((step, inputs))
        self._away = _Away(step, x, u, before.readings)
        if step - self._step > self._coast_steps:
            return _nothing(inputs)
        return self._estimate(COASTING, x, u)

    def _along_line(self, x: list[float], before: list[float], after: list[float], steps: int) -> list[float]:
        if steps == 1:
            return advance(self.discrete, x, before)
        for k in range(steps):
            x = advance(self.discrete, x, [a + (b - a) * k / steps for a, b in zip(before, after)])
        return x

    def _bridge(self, readings: list[tuple[int, Readings]], step: int, u: list[float]) -> list[float]:
        """The state at ``step`` with each missing input drawn as a line between the readings around it."""
        paths = []
        for index, (first, last) in enumerate(zip(self.last, u)):
            known = [
                (self._step, first),
                *((k, values[index]) for k, values in readings if values[index] is not None),
                (step, last),
            ]
            paths.append(_interpolated([(k, value) for k, value in known if value is not None]))
        x = self._x
        for inputs in zip(*paths):
            x = advance(self.discrete, x, inputs)
        return x

    def _estimate(self, status: str, x: list[float], u: list[float]) -> Estimate:
        ambient = output(self.discrete, self.estimator.offset, x, u)
        return Estimate(ambient, ambient + self.error_low_degC, ambient + self.error_high_degC, status, tuple(u))


def _nothing(inputs: Readings) -> Estimate:
    return Estimate(None, None, None, FAULTED, tuple(inputs))


def _interpolated(points: list[tuple[int, float]]) -> list[float]:
    """The values on the lines through ``points`` (step, value), without the last.

    Of several of a step the line to it ends at the first, as where nothing was missing, and the last counts from there.
    """
    values: list[float] = []
    for (k0, v0), (k1, v1) in itertools.pairwise(points):
        values.extend(v0 + (v1 - v0) * (k - k0) / (k1 - k0) for k in range(k0, k1))
    return values
