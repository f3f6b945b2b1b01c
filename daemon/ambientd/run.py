"""``ambientd run``: the parts put together, put together anew on SIGHUP, and taken apart again whatever happens."""

import os
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, NamedTuple

from ambient_model.faults import Refused, refuse
from ambient_model.model import Model
from ambient_model.tracking import TRACKING
from ambientd.fallback import FallbackTracker
from ambientd.notices import Notice, log
from ambientd.notify import Notifier
from ambientd.outlets import Outlets
from ambientd.schedule import SIGHUP, Ticks, Waiter, clock_s
from ambientd.service import Service
from ambientd.settings import Prepared, Settings
from ambientd.sources.assign import location_of, open_sensors
from ambientd.sources.sensors import Sensors

if TYPE_CHECKING:
    from ambientd.reference import OffsetLearner
    from ambientd.sources.replay import Sample
    from ambientd.state import StateFile

_WINDOW_S = 5.0
_MOST_MISSED = 0.1
"""The share of ticks beyond which their loss is reported: a single late one is not."""


class _Work(NamedTuple):
    """What a configuration and its model make: all that a reload replaces, but the publishers."""

    settings: Settings
    model: Model
    tracker: FallbackTracker
    sensors: Sensors
    state: "StateFile | None"
    learner: "OffsetLearner | None"

    def __str__(self) -> str:
        return (
            f"model '{self.model.name}' at {self.tracker.period_s:g} s on sensors under {self.settings.sysfs_root},"
            f" to {', '.join(map(str, self.settings.publish))}"
        )


def run_sensors(first: Callable[[], Prepared], again: Callable[[], Prepared]) -> None:
    """Poll the sensors at ``rate_hz`` and publish, until a signal ends it. Raises :class:`Refused`.

    SIGHUP calls ``again``: what it returns takes over, or is refused and changes nothing.
    """
    with (
        Waiter(pausing=(SIGHUP,)) as waiter,
        Outlets(waiter, 0, log) as outlets,
        Notifier(os.environ, log) as notifier,
    ):
        work = _opened(first(), waiter)
        try:
            if work.state is not None:
                work.state.take_back(work.tracker, clock_s())
            outlets.become(work.settings.publish, work.settings.state)
            log(str(work))
            service = Service(work.model, work.settings.level_percent, work.tracker, outlets.publish, work.learner)
            while True:
                waiter.carry_out(_Poll(work, service, notifier, waiter).run, work.sensors.reader.leave)
                if not waiter.paused() or waiter.ended:
                    break
                notifier.reloading()
                work = _reloaded(work, again, outlets, waiter)
                service.take_over(work.model, work.settings.level_percent, work.tracker, work.learner)
        finally:
            work.sensors.close()
            if work.state is not None:
                work.state.close()


def _opened(prepared: Prepared, waiter: Waiter) -> _Work:
    settings, model, identity, code = prepared
    tracker = FallbackTracker(model, 1 / settings.rate_hz, settings.level_percent, settings.coast_s, code)
    state = learner = None
    if settings.state is not None:
        from ambientd.state import StateFile

        if settings.reference is not None:
            from ambientd.reference import OffsetLearner

            learner = OffsetLearner(settings.reference, settings.level_percent, settings.state.path, log)
            if model.readings is not None and tracker.validation is not None:
                learner.learn_sensors(model.readings, tracker.validation)
        state = StateFile(settings.state, identity, log, learner)
    return _Work(settings, model, tracker, open_sensors(settings, model, log, waiter.set_alarm), state, learner)


def _reloaded(work: _Work, again: Callable[[], Prepared], outlets: Outlets, waiter: Waiter) -> _Work:
    """The new work, or where that is refused the old."""
    new = None
    try:
        new = _opened(again(), waiter)
        if faults := new.sensors.faults(_moved(work, new)):
            raise Refused(new.settings.source, faults)
        outlets.become(new.settings.publish, new.settings.state, proved=True)
    except Refused as refused:
        if new is not None:
            new.sensors.close()
        log(f"not reloaded, the old configuration stays: {refused}")
        return work
    if new.model == work.model:
        try:  # another rate may be another period, which starts anew
            new.tracker.restore(work.tracker.snapshot())
        except ValueError:
            pass
        if new.learner is not None and work.learner is not None:
            new.learner.restore(work.learner.memory(clock_s()), clock_s())
    work.sensors.close()
    log(f"reloaded: {new}")
    return new


def _moved(old: _Work, new: _Work) -> list[str]:
    """The inputs that the new configuration reads elsewhere, or the old model lacks."""

    def places(work: _Work) -> set[tuple[str, object]]:
        root = work.settings.sysfs_root, work.settings.zones_by_name
        return {(each.name, (root, location_of(work.settings, each))) for each in work.model.main.inputs}

    return [name for name, _ in places(new) - places(old)]


class _Poll:
    """Ticks of one configuration; :meth:`run` continues where another thread has hung."""

    def __init__(self, work: _Work, service: Service, notifier: Notifier, waiter: Waiter) -> None:
        # a record's fields take longer to get
        self._model, self._tracker, self._sensors, self._state = work.model, work.tracker, work.sensors, work.state
        self._tick = service.tick
        self._notifier, self._is_watched = notifier, notifier.is_open
        period_s = 1 / work.settings.rate_hz
        notifier.expect(period_s)
        self._ticks = Ticks(period_s, waiter.until)
        self._each = iter(self._ticks)
        self._pace = _Pace(self._ticks, period_s)
        self._unfinished_s: float | None = None
        self._status = ""
        self._refused: dict[str, str] = {}

    def run(self) -> None:
        """Tick until a signal comes."""
        self._sensors.reader.begin()
        if self._unfinished_s is not None:
            self._round(self._unfinished_s)
        for now_s in self._each:
            self._unfinished_s = now_s
            self._round(now_s)

    def _round(self, now_s: float) -> None:
        ticks, pace = self._ticks, self._pace
        estimate = self._tick((now_s, self._sensors.read(now_s)), ticks.missed, ticks.steps_back)
        if ticks.missed != pace.missed or ticks.back_s or pace.is_reported:
            pace.ticked(now_s)
        status = estimate.status
        if status != TRACKING or self._status != TRACKING:
            self._report(status)
        if self._is_watched:
            self._notifier.ticked(now_s)
        if self._state is not None:
            self._state.ticked(self._tracker, now_s)

    def _report(self, status: str) -> None:
        """Report a change of ``status``, and of what is refused: while it is ``tracking`` nothing is."""
        refused = self._tracker.refused
        if refused.keys() != self._refused.keys():
            _note_refused(self._refused, refused)
        self._refused = refused
        if status != self._status:
            report = self._notifier.status if self._status else self._notifier.ready
            self._status = status
            report(f"model '{self._model.name}': {status}")


class _Pace:
    """Reports ticks that cannot be held, and a clock that goes back."""

    def __init__(self, ticks: Ticks, period_s: float) -> None:
        self._ticks = ticks
        self._window_s = max(_WINDOW_S, 10 * period_s)
        self._count = round(self._window_s / period_s)
        self._held, self._forwards = Notice(), Notice()
        self._since_s = clock_s()
        self.missed = 0
        """How many there were when the last seconds were looked at."""
        self.is_reported = False
        """Whether something is wrong that was reported."""

    def ticked(self, now_s: float) -> None:
        """Look at the last tick, and now and then at those of the last seconds; needed while there is trouble."""
        back_s = self._ticks.back_s
        if (back_s or self._forwards.wrong) and self._forwards.changed(now_s, back_s > 0) and back_s:
            log(f"the clock went back by {back_s:.3g} s: the estimate starts anew")
        self.is_reported = self._held.wrong or self._forwards.wrong
        if 0 <= now_s - self._since_s < self._window_s:
            return
        missed = self._ticks.missed - self.missed
        late = missed >= _MOST_MISSED * self._count
        if self._held.changed(now_s, late):
            problem = f"cannot be held, {missed} of {self._count} were missed: lower rate_hz, or leave out slow sensors"
            if missed > self._count:
                stood_s = missed * self._window_s / self._count
                problem = f"stood still for {stood_s:.0f} s: a sensor hung, or the process was stopped"
            log(f"ticks {problem if late else 'are held again'}")
        self.is_reported = self._held.wrong or self._forwards.wrong
        self._since_s, self.missed = now_s, self._ticks.missed


def _note_refused(before: dict[str, str], now: dict[str, str]) -> None:
    for name in now.keys() - before.keys():
        log(f"sensor {name}: refused ({now[name]})")
    for name in before.keys() - now.keys():
        log(f"sensor {name}: is accepted again")


def run_replayed(settings: Settings, trace: str, rate_hz: float | None, speed: float) -> None:
    """Publish the estimates for ``trace`` and end with it, or when a signal comes. Raises :class:`Refused`.

    A row comes 1 / ``rate_hz`` s after the last, or, where that is None, as the trace's times log, ``speed`` times as
    fast; 0 is as fast as it goes.
    """
    from ambient_model.codec import load_model
    from ambientd.sources.replay import TraceSource, tracker_for

    model = load_model(settings.model)
    in_a_hurry = rate_hz is None and speed == 0
    with (
        Waiter() as waiter,
        TraceSource(trace, model.main.inputs) as source,
        Outlets(waiter, None if in_a_hurry else 0, log) as outlets,
        Notifier(os.environ, log) as notifier,
    ):
        tracker = tracker_for(model, source, settings.level_percent, settings.coast_s)
        outlets.become(settings.publish)
        log(f"model '{model.name}' at {tracker.period_s:g} s on {trace}, to {', '.join(map(str, settings.publish))}")
        service = Service(model, settings.level_percent, tracker, outlets.publish)
        report: Callable[[str], None] = notifier.ready
        reported = ""
        for sample in _paced(iter(source), _delay_after_start(rate_hz, speed), waiter.until):
            estimate = service.tick(sample)
            if estimate.status != reported:
                reported = estimate.status
                report(f"model '{model.name}': {reported}")
                report = notifier.status
            notifier.ticked(clock_s())
        if outlets.unpublished and not waiter.ended:
            raise refuse(", ".join(outlets.unpublished), "", "could not be written at any row", "see the message above")


def withdraw(settings: Settings) -> None:
    """Leave what the daemon's end leaves, after one that was killed. Raises :class:`Refused` where one is at work."""
    with Waiter() as waiter, Outlets(waiter, 0, log) as outlets:
        outlets.become(settings.publish, settings.state)


def _delay_after_start(rate_hz: float | None, speed: float) -> Callable[[int, float], float]:
    """From a row's number and its time after the first row's, how long after the start it is due, all in s."""
    if rate_hz is not None:
        return lambda row, passed_s: row / rate_hz
    if speed == 0:
        return lambda row, passed_s: 0.0
    return lambda row, passed_s: passed_s / speed


def _paced(
    rows: "Iterator[Sample]", delay_s: Callable[[int, float], float], until: Callable[[float, float], float | None]
) -> "Iterator[Sample]":
    start_s = clock_s()
    first_s: float | None = None
    for index, sample in enumerate(rows):
        first_s = sample[0] if first_s is None else first_s
        if until(start_s + delay_s(index, sample[0] - first_s), clock_s()) is None:
            return
        yield sample
