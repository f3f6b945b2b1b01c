"""The main estimator blended with the secondary one, with the interval of the error variance model.

The secondary estimator has a tracker like the main one, of the same inputs and periods: both bridge a gap, coast and
start anew at the same samples. The error variance advances in whole periods like the recursion, and its state belongs
to the last sample at which every input was there. While inputs are missing it is predicted from there, and the interval
never shrinks; a new start begins in steady state. Without both, the estimate is the main estimator's.
"""

from typing import NamedTuple

from ambient_model.blend import blended
from ambient_model.error_variance import VarianceState, advanced, gains, initial_state, sigma_degC
from ambient_model.model import ErrorVariance, Model
from ambient_model.tracking import COASTING, DEGRADED, Estimate, Readings, Snapshot, Tracker


class Background(NamedTuple):
    """The state of an :class:`Observer` beside its main estimator's :class:`Snapshot`."""

    secondary: Snapshot | None
    variance: VarianceState | None


class Observer:
    """Blends ``tracker``, the main estimator's, and publishes the interval of ``level`` percent; see :class:`Tracker`.

    Its status is ``degraded`` while the secondary estimate is blended in and no input is missing, settled or not.
    """

    def __init__(self, model: Model, tracker: Tracker, level: int = 90, coast_s: float | None = None) -> None:
        self.tracker = tracker
        self.sigma_degC: float | None = None
        """Standard deviation of the last estimate's error; None without an error variance model or an estimate."""
        self._secondary: Tracker | None = None
        self._threshold_degC = 0.0
        if model.secondary is not None:
            estimator, self._threshold_degC = model.secondary
            [discrete] = [each for each in estimator.discrete if each.period_s == tracker.discrete.period_s]
            self._secondary = Tracker(estimator, discrete, level, coast_s)
        self._error_variance = model.error_variance
        self._low, self._high = (0.0, 0.0) if model.error_variance is None else model.error_variance.quantiles[level]
        self._variance: VarianceState | None = None
        self._step = 0
        """The tracker's step that the variance's state belongs to."""
        self._gains: tuple[int, tuple[float, ...]] = (-1, ())
        """The number of periods passed and the gains after them, which are mostly the same again."""

    def background(self) -> Background:
        """The state beside the tracker's snapshot, for :meth:`restore`; empty where that snapshot is None."""
        if self.tracker.snapshot() is None:
            return Background(None, None)
        return Background(None if self._secondary is None else self._secondary.snapshot(), self._variance)

    def fits(self, main: Snapshot, background: Background) -> bool:
        """Whether ``background`` is of this model and of the same sample as the main estimator's snapshot."""
        secondary, variance = background
        if (self._secondary is None, self._error_variance is None) != (secondary is None, variance is None):
            return False
        if self._secondary is not None and secondary is not None:
            together = (secondary.start_s, secondary.step) == (main.start_s, main.step)
            if not (together and self._secondary.fits(secondary)):
                return False
        if self._error_variance is not None and variance is not None:
            lengths = {len(self._error_variance.terms), len(variance.means_degC), len(variance.squares_degC2)}
            return len(lengths) == 1 and min(variance.squares_degC2, default=0.0) >= 0
        return True

    def restore(self, main: Snapshot, background: Background) -> None:
        """Continue from ``background``, which :meth:`fits`, once the tracker has been restored to ``main``."""
        if self._secondary is not None and background.secondary is not None:
            self._secondary.restore(background.secondary)
        if self._error_variance is not None and background.variance is not None:
            self._variance, self._step = background.variance, main.step
            self.sigma_degC = sigma_degC(self._error_variance, background.variance)

    def update(self, time_s: float, readings: Readings) -> Estimate:
        """The estimate at ``time_s``, as :meth:`Tracker.update` takes it."""
        estimate = self.tracker.update(time_s, readings)
        secondary_degC = None if self._secondary is None else self._secondary.update(time_s, readings).ambient_degC
        ambient, low, high, status, used = estimate
        if ambient is None:
            self.sigma_degC = None
            return estimate
        difference = 0.0
        if secondary_degC is not None:
            ambient, difference, weight = blended(ambient, secondary_degC, self._threshold_degC)
            # beyond the threshold, the difference carries no more information on the blended estimate's error
            difference = min(max(difference, -self._threshold_degC), self._threshold_degC)
            if weight > 0 and status != COASTING:
                status = DEGRADED
        if self._error_variance is None:
            low, high = ambient + self.tracker.error_low_degC, ambient + self.tracker.error_high_degC
        else:
            self.sigma_degC = sigma = self._sigma(self._error_variance, ambient, difference, status == COASTING)
            low, high = ambient + self._low * sigma, ambient + self._high * sigma
        return Estimate(ambient, low, high, status, used)

    def _sigma(self, model: ErrorVariance, ambient: float, difference: float, coasting: bool) -> float:
        step = self.tracker.step
        if self._variance is None or step == 0:
            variance = initial_state(model, ambient, difference)
        else:
            a = self._gains_after(model, step - self._step)
            variance = advanced(model, self._variance, a, ambient, difference)
        sigma = sigma_degC(model, variance)
        if coasting:
            return max(sigma, self.sigma_degC or 0.0)
        self._variance, self._step = variance, step
        return sigma

    def _gains_after(self, model: ErrorVariance, steps: int) -> tuple[float, ...]:
        if self._gains[0] != steps:
            self._gains = (steps, gains(model, steps * self.tracker.discrete.period_s))
        return self._gains[1]
