"""The daemon's round: a sample in, an estimate and its age out."""

from collections.abc import Callable
from typing import TYPE_CHECKING

from ambient_model.model import Model
from ambient_model.tracking import Estimate
from ambientd.fallback import FallbackTracker
from ambientd.health import ALL_INPUTS
from ambientd.report import Report

if TYPE_CHECKING:
    from ambientd.reference import OffsetLearner
    from ambientd.sources.replay import Sample

_NEW = tuple.__new__  # a named tuple's own costs a call more


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
        self._about = model.name, model.main.inputs, level_percent
        self._tracker = tracker
        self._learner = learner

    def tick(self, sample: "Sample", missed_ticks: int = 0, clock_steps_back: int = 0) -> Estimate:
        """One round; the estimate that was published."""
        time_s, raw = sample
        learner, offset = self._learner, None
        if learner is None:
            estimate = self._tracker.update(time_s, raw)
        else:
            estimate = learner.update(time_s, self._tracker.update(time_s, learner.corrected(raw)))
            offset = learner.report
        if estimate.status in ALL_INPUTS:
            self._fresh_s = time_s
        age_s = None if self._fresh_s is None else time_s - self._fresh_s
        report = (*self._about, time_s, raw, estimate, age_s, missed_ticks, clock_steps_back, offset)
        self._publish(_NEW(Report, report))
        return estimate
