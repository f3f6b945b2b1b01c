"""A model as a device runs it while its inputs are there: the main estimator, its guard, and its spread.

The guard is a tracker like the main one, of the same inputs and periods: what bridges a gap, coasts or starts anew in
the one does so in the other. Time passes for the spread as for the recursion, in whole periods, and its unrest belongs
to the last moment at which every input was there. While inputs are missing it is foreseen from there, and the interval
never shrinks; a new start begins at rest. Without guard and spread nothing differs from the main estimator.
"""

from typing import NamedTuple

from ambient_model.guard import guarded
from ambient_model.model import Model, Spread
from ambient_model.spread import Unrest, at_rest, followed, gains, sigma_degC
from ambient_model.tracking import COASTING, DEGRADED, Estimate, Readings, Snapshot, Tracker


class Background(NamedTuple):
    """What an :class:`Observer` rests on beside its main estimator's :class:`Snapshot`."""

    guard: Snapshot | None
    unrest: Unrest | None


class Observer:
    """Listens to ``tracker``, the main estimator's, and publishes at ``level`` percent; see :class:`Tracker`.

    Its status is ``degraded`` while the guard has a say and no input is missing, settled or not.
    """

    def __init__(self, model: Model, tracker: Tracker, level: int = 90, coast_s: float | None = None) -> None:
        self.tracker = tracker
        self.sigma_degC: float | None = None
        """The standard deviation behind the last estimate; None where there is no spread, or no estimate."""
        self._guard: Tracker | None = None
        self._threshold_degC = 0.0
        if model.guard is not None:
            estimator, self._threshold_degC = model.guard
            [discrete] = [each for each in estimator.discrete if each.period_s == tracker.discrete.period_s]
            self._guard = Tracker(estimator, discrete, level, coast_s)
        self._spread = model.spread
        self._low, self._high = (0.0, 0.0) if model.spread is None else model.spread.quantiles[level]
        self._unrest: Unrest | None = None
        self._step = 0
        """The tracker's when the unrest was taken."""
        self._gains: tuple[int, tuple[float, ...]] = (-1, ())
        """How many periods have passed, and the low-passes' gains after them: mostly the same again."""

    def background(self) -> Background:
        """What it rests on beside the tracker's snapshot, for :meth:`restore`; nothing where that is None."""
        if self.tracker.snapshot() is None:
            return Background(None, None)
        return Background(None if self._guard is None else self._guard.snapshot(), self._unrest)

    def fits(self, main: Snapshot, background: Background) -> bool:
        """Whether ``background`` is of this model and of the same moment as the main estimator's snapshot."""
        guard, unrest = background
        if (self._guard is None, self._spread is None) != (guard is None, unrest is None):
            return False
        if self._guard is not None and guard is not None:
            together = (guard.start_s, guard.step) == (main.start_s, main.step)
            if not (together and self._guard.fits(guard)):
                return False
        if self._spread is not None and unrest is not None:
            lengths = {len(self._spread.terms), len(unrest.means_degC), len(unrest.squares_degC2)}
            return len(lengths) == 1 and min(unrest.squares_degC2, default=0.0) >= 0
        return True

    def restore(self, main: Snapshot, background: Background) -> None:
        """Go on from ``background``, which :meth:`fits`, once the tracker has been restored to ``main``."""
        if self._guard is not None and background.guard is not None:
            self._guard.restore(background.guard)
        if self._spread is not None and background.unrest is not None:
            self._unrest, self._step = background.unrest, main.step
            self.sigma_degC = sigma_degC(self._spread, background.unrest)

    def update(self, time_s: float, readings: Readings) -> Estimate:
        """The estimate at ``time_s``, as :meth:`Tracker.update` takes it."""
        estimate = self.tracker.update(time_s, readings)
        guard_degC = None if self._guard is None else self._guard.update(time_s, readings).ambient_degC
        ambient, low, high, status, used = estimate
        if ambient is None:
            self.sigma_degC = None
            return estimate
        apart = 0.0
        if guard_degC is not None:
            ambient, apart, weight = guarded(ambient, guard_degC, self._threshold_degC)
            # where the guard has the last word, how far off the main one is says nothing of the estimate
            apart = min(max(apart, -self._threshold_degC), self._threshold_degC)
            if weight > 0 and status != COASTING:
                status = DEGRADED
        if self._spread is None:
            low, high = ambient + self.tracker.error_low_degC, ambient + self.tracker.error_high_degC
        else:
            self.sigma_degC = sigma = self._sigma(self._spread, ambient, apart, status == COASTING)
            low, high = ambient + self._low * sigma, ambient + self._high * sigma
        return Estimate(ambient, low, high, status, used)

    def _sigma(self, spread: Spread, ambient: float, apart: float, coasting: bool) -> float:
        step = self.tracker.step
        if self._unrest is None or step == 0:
            unrest = at_rest(spread, ambient, apart)
        else:
            unrest = followed(spread, self._unrest, self._gains_after(spread, step - self._step), ambient, apart)
        sigma = sigma_degC(spread, unrest)
        if coasting:
            return max(sigma, self.sigma_degC or 0.0)
        self._unrest, self._step = unrest, step
        return sigma

    def _gains_after(self, spread: Spread, steps: int) -> tuple[float, ...]:
        if self._gains[0] != steps:
            self._gains = (steps, gains(spread, steps * self.tracker.discrete.period_s))
        return self._gains[1]
