"""The daemon's round: read, estimate, publish. A publisher that fails is told of once, and stops nothing."""

from collections.abc import Callable, Iterator, Sequence

from ambient_model.model import Model
from ambient_model.tracking import DEGRADED, TRACKING, WARMING_UP, Estimate
from ambientd.fallback import FallbackTracker
from ambientd.notices import Notice
from ambientd.publish import Publisher
from ambientd.report import Report
from ambientd.sources.replay import Sample


class Service:
    """Takes samples (time in s, one reading per input) through the tracker to the publishers, each with its name."""

    def __init__(
        self,
        model: Model,
        level_percent: int,
        tracker: FallbackTracker,
        samples: Iterator[Sample],
        publishers: Sequence[tuple[str, Publisher]],
        note: Callable[[str], None],
    ) -> None:
        self._model = model
        self._level_percent = level_percent
        self._tracker = tracker
        self._samples = samples
        self._publishers = [(name, publisher, Notice()) for name, publisher in publishers]
        self._note = note
        self._fresh_s: float | None = None
        self.unheard = [name for name, _ in publishers]
        """The publishers that have not published anything yet."""

    def tick(self) -> bool:
        """One round; False where there is nothing more to read."""
        sample = next(self._samples, None)
        if sample is None:
            return False
        estimate = self._tracker.update(*sample)
        self._publish(self._report(sample, estimate))
        return True

    def _report(self, sample: Sample, estimate: Estimate) -> Report:
        time_s, raw = sample
        if estimate.status in (WARMING_UP, TRACKING, DEGRADED):
            self._fresh_s = time_s
        age_s = None if self._fresh_s is None else time_s - self._fresh_s
        return Report(self._model.name, self._model.main.inputs, self._level_percent, time_s, raw, estimate, age_s)

    def _publish(self, report: Report) -> None:
        for name, publisher, notice in self._publishers:
            problem = ""
            try:
                publisher.publish(report)
                if name in self.unheard:
                    self.unheard.remove(name)
            except OSError as error:
                problem = error.strerror or str(error)
            if notice.changed(report.time_s, bool(problem)):
                self._note(f"{name}: {f'cannot be written ({problem}); the others go on' if problem else 'is back'}")
