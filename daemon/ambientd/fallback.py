"""Fallback estimators: while an input is missing, the one that does without it is active, without a jump.

Where the input is missing for longer than is bridged, the main estimator starts anew when it is back, and becomes
active once it has settled.

Every fallback takes all samples that the main estimator takes, so that it has settled when it is needed; while it is
not active it takes them in batches, which costs a fraction and gives the same state. Where the active estimator
changes, the difference to the last published estimate is added to the new one's, and decays as a thermal state does. It
knows no clock: time comes in as an argument. Where the model file holds what its readings are expected to be, no
fallback runs: see :mod:`ambient_model.validation`.
"""

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

from ambient_model.model import Estimator, Model
from ambient_model.tracking import WARMING_UP, Estimate, Readings, Snapshot, Tracker, bridge_limit_s, nearest_discrete
from ambientd.health import ALL_INPUTS, MAIN, decide

if TYPE_CHECKING:
    from types import CodeType

    from ambient_model.observer import Background, Observer

_NONE_REFUSED: dict[str, str] = {}
_MOST_BEHIND = 128
"""Samples in a batch of the fallbacks: enough for the cost to vanish, few enough to be processed in a millisecond."""


class FallbackState(NamedTuple):
    """State of a :class:`FallbackTracker`, for another of the same model."""

    snapshots: tuple[Snapshot | None, ...]
    """The main estimator's, then each fallback's; None for one that has not begun."""
    active: int
    """The index of the active one."""
    difference_degC: float
    last_degC: float | None
    """The last published estimate."""
    last_s: float
    background: "Background | None" = None
    """Of a model with a secondary estimator or an error variance model."""


def usual_code(model: Model, period_s: float, level: int) -> "CodeType":
    """The compiled code of the main estimator's usual sample; see :mod:`ambient_model.straight`."""
    from ambient_model.straight import compiled

    return compiled(model, nearest_discrete(model.main, period_s), level)


class _Member:
    """An estimator at work, fed from the readings of all the model's inputs."""

    def __init__(self, model: Model, estimator: Estimator, period_s: float, level: int, coast_s: float | None) -> None:
        self.tracker = Tracker(estimator, nearest_discrete(estimator, period_s), level, coast_s)
        self._picks = [model.main.inputs.index(each) for each in estimator.inputs]
        self._width = len(model.main.inputs)

    def update(self, time_s: float, readings: Readings) -> Estimate:
        return self.tracker.update(time_s, [readings[index] for index in self._picks])

    def follow(self, samples: list[tuple[float, list[float]]]) -> None:
        """Take samples that are complete and in their ranges."""
        for time_s, readings in samples:
            self.tracker.follow(time_s, [readings[index] for index in self._picks])

    def used(self, estimate: Estimate) -> tuple[float | None, ...]:
        """Its inputs, per input of the model: None for the one that it does without."""
        values: list[float | None] = [None] * self._width
        for index, value in zip(self._picks, estimate.used):
            values[index] = value
        return tuple(values)


class FallbackTracker:
    """A model's main estimator and its fallbacks, fed one sample at a time; the interval is that of ``level`` percent.

    Secondary estimator and error variance model belong to the main one: a fallback has its own interval.

    ``period_s`` is how far apart the samples will lie. Two missing inputs leave no fallback: the main one coasts, for
    ``coast_s`` or, where that is None, as long as a gap is bridged. ``code`` is what :func:`usual_code` returned.
    """

    def __init__(
        self,
        model: Model,
        period_s: float,
        level: int = 90,
        coast_s: float | None = None,
        code: "CodeType | None" = None,
    ) -> None:
        self._main = _Member(model, model.main, period_s, level, coast_s)
        self._observer = _observer(model, self._main.tracker, level, coast_s)
        self.validation = None if self._observer is None else self._observer.validation
        self._update_main = self._main.tracker.update if self._observer is None else self._observer.update
        self._update_usual = _usual_update(
            code or usual_code(model, period_s, level), self._main.tracker, self._observer
        )
        # validated readings are never missing
        fallbacks = model.fallbacks if model.readings is None else {}
        self._fallbacks = [_Member(model, each, period_s, level, coast_s) for each in fallbacks.values()]
        self.period_s = self._main.tracker.discrete.period_s
        self.limit_s = bridge_limit_s(self.period_s)
        settling_steps = max(member.tracker.settling_steps for member in (self._main, *self._fallbacks))
        # down to 5 % when the slowest has settled; a static model has no time of its own
        self._decay_s = max(self.limit_s, settling_steps * self.period_s / 3)
        self._batch: list[tuple[float, list[float]]] = []
        self._active = self._main
        self._difference_degC = 0.0
        self._last_degC: float | None = None
        self._last_s = 0.0

    @property
    def refused(self) -> dict[str, str]:
        """Why readings are refused, by the input's name."""
        validation = self.validation
        if validation is None or not (validation.refused or validation.absent or validation.is_frozen):
            return _NONE_REFUSED
        inputs = self._main.tracker.estimator.inputs
        return {inputs[i].name: why for i, why in validation.refusals().items()}

    @property
    def _members(self) -> list[_Member]:
        return [self._main, *self._fallbacks]

    @property
    def _settled(self) -> bool:
        """Whether the main one has, which its status ``degraded`` leaves open."""
        return self._main.tracker.step >= self._main.tracker.settling_steps

    def _catch_up(self) -> None:
        for member in self._fallbacks:
            member.follow(self._batch)
        self._batch = []

    def snapshot(self) -> FallbackState:
        """Its state, for :meth:`restore`."""
        self._catch_up()
        return FallbackState(
            tuple([member.tracker.snapshot() for member in self._members]),
            self._members.index(self._active),
            self._difference_degC,
            self._last_degC,
            self._last_s,
            None if self._observer is None else self._observer.background(),
        )

    def restore(self, state: FallbackState) -> None:
        """Go on from ``state``; raises ValueError, and changes nothing, where it is of another model or period."""
        members = self._members
        if len(state.snapshots) != len(members) or not 0 <= state.active < len(members):
            raise ValueError("it has other estimators")
        pairs = [
            (member.tracker, snapshot) for member, snapshot in zip(members, state.snapshots) if snapshot is not None
        ]
        if not all([tracker.fits(snapshot) for tracker, snapshot in pairs]):
            raise ValueError("it has another period or shape")
        main, background = state.snapshots[0], state.background
        if (self._observer is None) != (background is None):
            raise ValueError("it has other estimators")
        if main is not None and self._observer is not None and background is not None:
            if not self._observer.fits(main, background):
                raise ValueError("it has another secondary estimator or error variance")
            self._observer.restore(main, background)
        self._catch_up()
        for tracker, snapshot in pairs:
            tracker.restore(snapshot)
        self._active = members[state.active]
        self._difference_degC, self._last_degC, self._last_s = state[2:5]

    def update(self, time_s: float, readings: Readings) -> Estimate:
        """The estimate at ``time_s`` from one reading per input of the model (degC, A, ...; None where missing)."""
        main = self._update_usual(time_s, readings) or self._update_main(time_s, readings)
        if not self._fallbacks:
            return main
        if main.status in ALL_INPUTS and (self._active is self._main or self._settled):
            self._batch.append((time_s, self._main.tracker.last))
            if len(self._batch) >= _MOST_BEHIND:
                self._catch_up()
            if self._active is self._main and self._difference_degC == 0:  # nothing is left to decay
                self._last_degC, self._last_s = main.ambient_degC, time_s
                return main
            return self._publish(time_s, self._main, main)
        self._catch_up()
        others = [(member, member.update(time_s, readings)) for member in self._fallbacks]
        return self._publish(time_s, *self._choose(main, others))

    def _publish(self, time_s: float, member: _Member, estimate: Estimate) -> Estimate:
        """The estimate to publish, from that of the active ``member``."""
        ambient, low, high, status, used = estimate
        if ambient is None or low is None or high is None:
            self._active, self._last_degC = member, None
            return estimate
        self._difference_degC = difference = self._bridge(time_s, member, ambient)
        self._active, self._last_degC, self._last_s = member, ambient + difference, time_s
        # the interval holds both ends of the bridge
        return Estimate(
            self._last_degC,
            low + min(0.0, difference),
            high + max(0.0, difference),
            status,
            used if member is self._main else member.used(estimate),
        )

    def _choose(self, main: Estimate, others: list[tuple[_Member, Estimate]]) -> tuple[_Member, Estimate]:
        """The active estimator where the main one lacks an input, or lacked one and has not settled since."""
        own = WARMING_UP if main.status in ALL_INPUTS else main.status
        active = self._members.index(self._active)
        number, status = decide(own, [estimate.status for _, estimate in others], active)
        if number == MAIN:
            return self._main, main
        member, estimate = others[number - 1]
        return member, estimate._replace(status=status)

    def _bridge(self, time_s: float, member: _Member, ambient_degC: float) -> float:
        """The difference to add to ``ambient_degC``, the estimate of ``member`` at ``time_s``."""
        passed_s = time_s - self._last_s
        if self._last_degC is None or not 0 <= passed_s <= self.limit_s:
            return 0.0
        if member is not self._active:
            return self._last_degC - ambient_degC
        return self._difference_degC * math.exp(-passed_s / self._decay_s)


def _usual_update(
    code: "CodeType", main: Tracker, observer: "Observer | None"
) -> Callable[[float, Readings], Estimate | None]:
    """The function of :mod:`ambient_model.straight` at work on these."""
    space: dict[str, Any] = {"main": main, "observer": observer, "secondary": None, "validation": None}
    if observer is not None:
        space.update(secondary=observer.secondary, validation=observer.validation)
    exec(code, space)
    update: Callable[[float, Readings], Estimate | None] = space["update"]
    return update


def _observer(model: Model, main: Tracker, level: int, coast_s: float | None) -> "Observer | None":
    """The main estimator's observer, where the model has a secondary estimator or an error variance model."""
    if model.secondary is None and model.error_variance is None and model.readings is None:
        return None
    from ambient_model.observer import Observer

    return Observer(model, main, level, coast_s)
