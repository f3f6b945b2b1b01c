"""References of the ambient, from a configured file and from ``ambientd tell``, update the unit's offset.

Both are files that are looked at once a second: another program writes the configured one, and ``ambientd tell``
writes ``STATE.tell`` beside the state file. The file's modification time is the reading's. One reading counts per
correlation time, while the status is ``tracking`` or ``degraded``, and never when it is older than configured; the
configured file is not looked at before one could count. The answer to a submitted reading stands in the state file;
then its file is removed.

Sensors' own errors that are learnt go into the readings over an hour, a little at a time, and into the estimate at
once, as what they make of it at rest: a step in the readings would shake the filter.
"""

import math
import os
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

from ambient_model.faults import Refused
from ambient_model.intake import read_whole
from ambient_model.tracking import Estimate
from ambient_model.unit_offset import (
    LEARNING,
    OffsetPrior,
    OffsetState,
    SensorOffsets,
    corrected,
    estimate_variance_degC2,
    initial,
    learning_sensors,
    predicted,
    sensors_updated,
    shifted,
    updated,
)
from ambientd.notices import Notice
from ambientd.sources.quantities import reference_degC

if TYPE_CHECKING:
    from ambient_model.model import Matrix, ReadingModel
    from ambient_model.tracking import Readings
    from ambient_model.validation import Validation
    from ambientd.settings import ReferenceSpec

LARGEST_BYTES = 256
_POLL_S = 0.95
"""Once a second at 1 Hz, too, where ticks jitter."""
_ADVANCE_S = 10.0
"""How often the offset is predicted: it changes over days, and what is taken off the readings over an hour."""
_AHEAD_S = 5.0
"""How far a file's time may lie ahead of the clock."""
_DAY_S = 86400.0
_TAKEN_OFF_S = 3600.0
"""Time constant with which sensors' errors that are learnt go into the readings."""


class LastReference(NamedTuple):
    """The last reading that was judged."""

    unix_s: float
    degC: float | None
    sigma_degC: float | None
    counted: bool
    outcome: str


class OffsetMemory(NamedTuple):
    """What outlives a restart; times are of the calendar, as a device may be off."""

    offset_degC: float
    variance_degC2: float
    unix_s: float
    counted_unix_s: float
    """Time of the last reading that counted; 0 before any."""
    last: LastReference | None
    sensors_degC: tuple[float, ...] = ()
    seen: int = 0
    """Sensors' own errors, and how often they were seen."""
    taken_off_degC: tuple[float, ...] = ()
    """What of them is taken off the readings by then; empty before anything is."""


class OffsetReport(NamedTuple):
    """What is published of it."""

    offset_degC: float
    std_degC: float
    last: LastReference | None


def submission_path(state_path: str) -> str:
    """Where ``ambientd tell`` hands a reading over."""
    return f"{state_path}.tell"


class OffsetLearner:
    """The unit's offset and the files that update it; ``note`` takes a message on what counted or is refused."""

    def __init__(
        self,
        spec: "ReferenceSpec",
        level_percent: int,
        state_path: str,
        note: Callable[[str], None],
        wall_s: Callable[[], float] = time.time,
    ) -> None:
        self._spec = spec
        self._level = level_percent
        self._prior = OffsetPrior(spec.offset_std_degC, spec.max_offset_degC, spec.forget_days * _DAY_S)
        self._state = initial(self._prior)
        self._submitted = submission_path(state_path)
        self._note = note
        self._notice = Notice()
        self._wall_s = wall_s
        self._polled_s = self._advanced_s = -math.inf
        self._seen_ns: dict[str, int] = {}
        self._counted_unix_s = self._refused_unix_s = 0.0
        self._last: LastReference | None = None
        self._sensors = SensorOffsets(())
        self._taken_off: list[float] = []
        """What is taken off the readings, which follows ``_sensors``; empty before anything is."""
        self._gains: Matrix = ()
        self._validation: Validation | None = None
        self.unsaved = False
        """Whether a reading has changed what :meth:`memory` holds."""
        self._note_report()

    def learn_sensors(self, model: "ReadingModel", validation: "Validation") -> None:
        """Learn sensors' own errors, too, from the differences that ``validation`` finds; before :meth:`restore`.

        What is left for the offset is no more uncertain than these errors make the estimate.
        """
        if model.offset_gains:
            self._gains, self._validation = model.offset_gains, validation
            self._prior = learning_sensors(self._prior, model)
            self._state = initial(self._prior)

    def corrected(self, readings: "Readings") -> "Readings":
        """The readings without the sensors' own errors."""
        return corrected(readings, self._taken_off) if self._taken_off else readings

    def update(self, time_s: float, estimate: Estimate) -> Estimate:
        """The model's estimate at ``time_s``, moved by the offset, once the files have been looked at."""
        if not 0 <= time_s - self._polled_s < _POLL_S:
            self._polled_s = time_s
            if not 0 <= time_s - self._advanced_s < _ADVANCE_S:
                self._advance(time_s)
            if (at_ns := self._changed(self._submitted)) is not None:
                self._judge(self._submitted, "degC", at_ns, estimate)
                self.unsaved = True
            # one that was refused is not tried again and again until it passes
            judged_unix_s = max(self._counted_unix_s, self._refused_unix_s)
            if self._spec.path and not self._too_soon(self._wall_s(), judged_unix_s) and estimate.status in LEARNING:
                at_ns = self._changed(self._spec.path)
                if at_ns and not self._too_soon(at_ns / 1e9, judged_unix_s):
                    counted = self._judge(self._spec.path, self._spec.unit, at_ns, estimate)
                    self.unsaved = self.unsaved or counted
        return shifted(estimate, self.report.offset_degC)

    def _advance(self, time_s: float) -> None:
        """Predict the offset to ``time_s``, and take off the readings what is due by then."""
        passed_s, self._advanced_s = min(time_s - self._advanced_s, _DAY_S), time_s
        self._state = predicted(self._prior, self._state, time_s)
        if self._taken_off and passed_s > 0:
            a = -math.expm1(-passed_s / _TAKEN_OFF_S)
            self._taken_off = [now + a * (o - now) for now, o in zip(self._taken_off, self._sensors.degC)]
        self._note_report()

    def _note_report(self) -> None:
        offset_degC = self._state.offset_degC + self._ahead_degC(self._sensors)
        self.report = OffsetReport(offset_degC, math.sqrt(self._state.variance_degC2), self._last)
        """What is published of it; the same object until it is predicted again, or a reading is judged."""

    def _ahead_degC(self, sensors: SensorOffsets) -> float:
        """What the estimate changes by, at rest, until these are taken off the readings."""
        if self._validation is None:
            return 0.0
        changes = [now - each for now, each in zip(self._taken_off, sensors.degC)]
        ahead_degC: float = sum([gain * change for gain, change in zip(self._validation.gains, changes)])
        return ahead_degC

    def _seen(self) -> SensorOffsets:
        """Sensors' errors after another look at the differences, where there are any to be had."""
        if self._validation is None:
            return self._sensors
        self._taken_off = self._taken_off or [0.0] * len(self._gains)
        slow_degC = self._validation.slow_differences(self._taken_off)
        before = self._sensors if self._sensors.degC else SensorOffsets((0.0,) * len(self._gains))
        return before if slow_degC is None else sensors_updated(self._prior, before, self._gains, slow_degC)

    def memory(self, now_s: float) -> OffsetMemory:
        """Its state at ``now_s`` on the clock of the samples, for :meth:`restore`."""
        b, P, time_s = self._state
        unix_s = self._wall_s() - max(0.0, now_s - time_s)
        return OffsetMemory(b, P, unix_s, self._counted_unix_s, self._last, *self._sensors, tuple(self._taken_off))

    def restore(self, memory: OffsetMemory, now_s: float) -> None:
        """Continue from ``memory``, as far as the configuration lets it."""
        most, passed_s = self._prior.bound_degC, max(0.0, self._wall_s() - memory.unix_s)
        b = min(max(memory.offset_degC, -most), most)
        P = min(max(memory.variance_degC2, 0.0), self._prior.std_degC**2)
        self._advanced_s = now_s - passed_s
        self._state = OffsetState(b, P, self._advanced_s)
        self._counted_unix_s, self._last = memory.counted_unix_s, memory.last
        if self._gains and len(memory.sensors_degC) == len(self._gains):
            known = [each for each in (memory.taken_off_degC, memory.sensors_degC) if len(each) == len(self._gains)]
            taken_off, sensors = ([min(max(o, -most), most) for o in each] for each in (known[0], known[-1]))
            self._sensors, self._taken_off = SensorOffsets(tuple(sensors), memory.seen), taken_off
        self._advance(now_s)

    def saved(self) -> None:
        """The state file holds what :meth:`memory` returned: the reading that was handed over has its answer."""
        self.unsaved = False
        try:
            if os.stat(self._submitted).st_mtime_ns == self._seen_ns.get(self._submitted):
                os.unlink(self._submitted)
        except OSError:
            pass

    def _changed(self, path: str) -> int | None:
        """The file's modification time in ns, where it has not been judged."""
        # asked first, as an error that is raised at every look costs more than all the rest
        if not os.access(path, os.F_OK):
            return None
        try:
            at_ns = os.stat(path).st_mtime_ns
        except OSError:
            return None
        return None if self._seen_ns.get(path) == at_ns else at_ns

    def _too_soon(self, unix_s: float, after_unix_s: float) -> bool:
        """Whether a reading is of the same correlation time as another; one of the future is of a wrong clock."""
        return after_unix_s <= self._wall_s() + _AHEAD_S and unix_s - after_unix_s < self._spec.correlation_s

    def _judge(self, path: str, unit: str, at_ns: int, estimate: Estimate) -> bool:
        self._advance(self._polled_s)
        self._seen_ns[path] = at_ns
        unix_s = at_ns / 1e9
        value = sigma = None
        try:
            value, sigma = reference_degC(read_whole(path, LARGEST_BYTES), unit, self._spec.sigma_degC)
            outcome = self._counted(unix_s, value, sigma, estimate)
            counted = True
        except Refused as refused:
            counted, outcome = False, refused.faults[0].problem
        except ValueError as error:
            counted, outcome = False, str(error)
        self._last = LastReference(unix_s, value, sigma, counted, outcome)
        if counted:
            self._counted_unix_s = unix_s
        elif path != self._submitted:
            self._refused_unix_s = min(unix_s, self._wall_s())
        if counted or (path != self._submitted and self._notice.changed(self._polled_s, True)):
            self._note(f"reference {path}: {'counted' if counted else 'not counted'}, {outcome}")
        if counted:
            self._notice.changed(self._polled_s, False)
        self._note_report()
        return counted

    def _counted(self, unix_s: float, value_degC: float, sigma_degC: float, estimate: Estimate) -> str:
        """Update the offset and describe it; raises ValueError, with the reason, where the reading does not count."""
        age_s = self._wall_s() - unix_s
        if not -_AHEAD_S <= age_s <= self._spec.max_age_s:
            raise ValueError(f"it is {age_s:.0f} s old, and {self._spec.max_age_s:g} s are allowed")
        if estimate.status not in LEARNING or estimate.ambient_degC is None:
            raise ValueError(f"the status is {estimate.status}, and readings count while it is {' or '.join(LEARNING)}")
        if self._too_soon(unix_s, self._counted_unix_s):
            gap_s = unix_s - self._counted_unix_s
            raise ValueError(f"another counted {gap_s:.0f} s before, and one counts per {self._spec.correlation_s:g} s")
        sensors = self._seen()
        y = value_degC - estimate.ambient_degC - self._ahead_degC(sensors)
        R = sigma_degC**2 + estimate_variance_degC2(estimate, self._level, self._prior.std_degC**2)
        after = updated(self._prior, self._state, y, R)
        if after is None:
            raise ValueError(
                f"{value_degC:g} degC is {y - self._state.offset_degC:+.1f} degC from the estimate, more than 3 sigma"
            )
        self._state, self._sensors = after, sensors
        std = math.sqrt(after.variance_degC2)
        return f"{value_degC:g} +- {sigma_degC:g} degC: the offset is {after.offset_degC:+.2f} +- {std:.2f} degC"
