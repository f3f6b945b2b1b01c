"""The daemon's round: a sample in, an estimate and its age out."""

from collections.abc import Callable
from typing import TYPE_CHECKING

from ambient_model.model import Model
from ambient_model.tracking import DEGRADED, TRACKING, WARMING_UP, Estimate
from ambientd.fallback import FallbackTracker
from ambientd.report import Report

if TYPE_CHECKING:
    from ambientd.reference import OffsetLearner
    from ambientd.sources.replay import Sample


class Service:
    """Takes samples (time in s, one reading per input) through a model's tracker to ``publish``."""

    def __init__(
        self,
        model: Model,
        level_percent: int,
        tracker: FallbackTracker,
        publish: Callable[[Report], None],
        learner: "OffsetLearner | None" = None,
    ) -> None:
        self._publish = publish
        self._fresh_s: float | None = None
        self.take_over(model, level_percent, tracker, learner)

    def take_over(
        self, model: Model, level_percent: int, tracker: FallbackTracker, learner: "OffsetLearner | None" = None
    ) -> None:
        """Use another model from the next tick on."""
        self._name, self._inputs = model.name, model.main.inputs
        self._level_percent = level_percent
        self._tracker = tracker
        self._learner = learner

    def tick(self, sample: "Sample", missed_ticks: int = 0, clock_steps_back: int = 0) -> Estimate:
        """One round; the estimate that was published."""
        time_s, raw = sample
        estimate = self._tracker.update(time_s, raw)
        learner = self._learner
        if learner is not None:
            estimate = learner.update(time_s, estimate)
        if estimate.status in (WARMING_UP, TRACKING, DEGRADED):
            self._fresh_s = time_s
        age_s = None if self._fresh_s is None else time_s - self._fresh_s
        offset = None if learner is None else learner.report()
        about = (self._name, self._inputs, self._level_percent)
        self._publish(Report(*about, time_s, raw, estimate, age_s, missed_ticks, clock_steps_back, offset))
        return estimate
