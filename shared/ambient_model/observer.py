"""The main estimator blended with the secondary one, with the interval of the error variance model.

The secondary estimator has a tracker like the main one, of the same inputs and periods: both bridge a gap, coast and
start anew at the same samples. The error variance advances in whole periods like the recursion, and its state belongs
to the last sample at which every input was there. While inputs are missing it is predicted from there, and the interval
never shrinks; a new start begins in steady state. Without both, the estimate is the main estimator's.

Where the model file says what its readings are expected to be, they are validated first: what is missing or refused is
replaced, and both estimators run on. The estimate is ``degraded`` while a sensor is set aside, with an interval that
holds the variance of what replaces it, and ``coasting`` where too little is left; it stays in the bounds of the file.
"""

import math
from typing import NamedTuple

from ambient_model.blend import blended
from ambient_model.error_variance import VarianceState, advanced, beyond_degC, gains, initial_state, sigma_degC
from ambient_model.model import SCORES, ErrorVariance, Model, ReadingModel
from ambient_model.recursion import output
from ambient_model.tracking import (
    COASTING,
    DEGRADED,
    FAULTED,
    TRACKING,
    Estimate,
    Readings,
    Snapshot,
    Tracker,
    bridge_limit_s,
)
from ambient_model.validation import Validation, ValidationState


class Background(NamedTuple):
    """The state of an :class:`Observer` beside its main estimator's :class:`Snapshot`."""

    secondary: Snapshot | None
    variance: VarianceState | None
    validation: ValidationState | None = None


class Observer:
    """Blends ``tracker``, the main estimator's, and publishes the interval of ``level`` percent; see :class:`Tracker`.

    Its status is ``degraded`` while the secondary estimate is blended in and no input is missing, settled or not.
    """

    def __init__(self, model: Model, tracker: Tracker, level: int = 90, coast_s: float | None = None) -> None:
        self.tracker = tracker
        self.sigma_degC: float | None = None
        """Standard deviation of the last estimate's error; None without an error variance model or an estimate."""
        self.secondary: Tracker | None = None
        """The secondary estimator's tracker."""
        self._threshold_degC = 0.0
        if model.secondary is not None:
            estimator, self._threshold_degC = model.secondary
            [discrete] = [each for each in estimator.discrete if each.period_s == tracker.discrete.period_s]
            self.secondary = Tracker(estimator, discrete, level, coast_s)
        self._error_variance = model.error_variance
        self._low, self._high = (0.0, 0.0) if model.error_variance is None else model.error_variance.quantiles[level]
        self._variance: VarianceState | None = None
        self._step = 0
        """The tracker's step that the variance's state belongs to."""
        self._gains: tuple[int, tuple[float, ...]] = (-1, ())
        """The number of periods passed and the gains after them, which are mostly the same again."""
        self._readings = model.readings
        self.validation: Validation | None = None
        if model.readings is not None:
            self._coast_s = bridge_limit_s(tracker.discrete.period_s) if coast_s is None else coast_s
            self.validation = Validation(model.readings, model.main, tracker.discrete.period_s)
            self._ranges = [(each.min, each.max) for each in model.main.inputs]
            self._score = SCORES[level]
            self._coasted_s = 0.0
            self._last: tuple[float, float] | None = None
            """When something was last published, and what."""
            tracker.settling_steps = round(model.readings.settled_s / tracker.discrete.period_s)
            for each, start in zip((tracker, self.secondary), model.readings.starts):
                if each is not None:
                    each.start = start

    def background(self) -> Background:
        """The state beside the tracker's snapshot, for :meth:`restore`; empty where that snapshot is None."""
        if self.tracker.snapshot() is None:
            return Background(None, None)
        return Background(
            None if self.secondary is None else self.secondary.snapshot(),
            self._variance,
            None if self.validation is None else self.validation.snapshot(),
        )

    def fits(self, main: Snapshot, background: Background) -> bool:
        """Whether ``background`` is of this model and of the same sample as the main estimator's snapshot."""
        secondary, variance, validation = background
        own = (self.secondary, self._error_variance, self.validation)
        if [each is None for each in own] != [each is None for each in background]:
            return False
        if self.validation is not None and validation is not None and not self.validation.fits(validation):
            return False
        if self.secondary is not None and secondary is not None:
            together = (secondary.start_s, secondary.step) == (main.start_s, main.step)
            if not (together and self.secondary.fits(secondary)):
                return False
        if self._error_variance is not None and variance is not None:
            lengths = {len(self._error_variance.terms), len(variance.means_degC), len(variance.squares_degC2)}
            return len(lengths) == 1 and min(variance.squares_degC2, default=0.0) >= 0
        return True

    def restore(self, main: Snapshot, background: Background) -> None:
        """Continue from ``background``, which :meth:`fits`, once the tracker has been restored to ``main``."""
        if self.secondary is not None and background.secondary is not None:
            self.secondary.restore(background.secondary)
        if self._error_variance is not None and background.variance is not None:
            self._variance, self._step = background.variance, main.step
            ambient = output(self.tracker.discrete, self.tracker.estimator.offset, main.x, main.u)
            beyond = beyond_degC(self._error_variance, ambient)
            self.sigma_degC = sigma_degC(self._error_variance, background.variance, beyond)
        if self.validation is not None and background.validation is not None:
            self.validation.restore(background.validation)

    def update(self, time_s: float, readings: Readings) -> Estimate:
        """The estimate at ``time_s``, as :meth:`Tracker.update` takes it."""
        if self.validation is None or self._readings is None:
            return self._blended(time_s, readings)
        known = [
            value if value is not None and low <= value <= high else None
            for value, (low, high) in zip(readings, self._ranges)
        ]
        used = self.validation.update(time_s, known)
        # what the recursion took while too little was left is not trusted
        anew = self._coasted_s > self._coast_s and not self.validation.is_coasting
        if anew:
            self.validation.restart()
            used = self.validation.update(time_s, known)
        if anew or self.validation.starts_anew:
            for each in (self.tracker, self.secondary):
                if each is not None:
                    each.restart()
        estimate = self._blended(time_s, used or [None] * len(known))
        return self._bounded(time_s, estimate, self.validation, self._readings)

    def _bounded(self, time_s: float, estimate: Estimate, validation: Validation, bounds: ReadingModel) -> Estimate:
        """The estimate with the status and the variance of what was replaced, within the bounds of the output."""
        ambient, low, high, status, used = estimate
        if ambient is None or low is None or high is None:
            self._last = None
            return estimate
        y = min(max(ambient, bounds.output[0]), bounds.output[1])
        passed_s = self.tracker.discrete.period_s if self._last is None else time_s - self._last[0]
        if self._last is not None and not validation.starts_anew:
            reach = bounds.rate_K_per_s * max(passed_s, bounds.jump_s)
            y = min(max(y, self._last[1] - reach), self._last[1] + reach)
        self._last = (time_s, y)
        variance = validation.variance_degC2
        if variance or y != ambient:
            # what the bounds take off shows that the estimate is wrong by as much
            variance += ((y - ambient) / self._score) ** 2
            low = y - math.sqrt((ambient - low) ** 2 + self._score**2 * variance)
            high = y + math.sqrt((high - ambient) ** 2 + self._score**2 * variance)
        if status != COASTING and validation.is_coasting:
            self._coasted_s += passed_s
            if self._coasted_s > self._coast_s:
                self._last = None
                return Estimate(None, None, None, FAULTED, used)
            status = COASTING
        elif not validation.is_coasting:
            self._coasted_s = 0.0
        if status == TRACKING and (validation.is_degraded or y != ambient):
            status = DEGRADED
        return Estimate(y, low, high, status, used)

    def _blended(self, time_s: float, readings: Readings) -> Estimate:
        """The estimate from validated readings."""
        estimate = self.tracker.update(time_s, readings)
        secondary_degC = None if self.secondary is None else self.secondary.update(time_s, readings).ambient_degC
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
        sigma = sigma_degC(model, variance, beyond_degC(model, ambient))
        if coasting:
            return max(sigma, self.sigma_degC or 0.0)
        self._variance, self._step = variance, step
        return sigma

    def _gains_after(self, model: ErrorVariance, steps: int) -> tuple[float, ...]:
        if self._gains[0] != steps:
            self._gains = (steps, gains(model, steps * self.tracker.discrete.period_s))
        return self._gains[1]
