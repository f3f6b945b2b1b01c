"""While one input is away, the estimator that does without it speaks: the rule for taking over without a jump.

Where the input stays away for longer than is bridged, the main estimator starts anew when it is back, and is waited for
until it has settled.

Every fallback knows all that the main estimator knew, so that it has settled when it is needed; as long as nobody asks
it, it takes the samples some at a time, which costs a fraction and comes to the same. Where the voice changes, the
difference to what was last said is added to what the new one says, and fades as a thermal state does. It knows no
clock: time comes in as an argument.
"""

import math
from typing import TYPE_CHECKING, NamedTuple

from ambient_model.model import Estimator, Model
from ambient_model.tracking import (
    WARMING_UP,
    Estimate,
    Readings,
    Snapshot,
    Tracker,
    bridge_limit_s,
    nearest_discrete,
)
from ambientd.health import MAIN, decide, has_all_inputs

if TYPE_CHECKING:
    from ambient_model.observer import Background, Observer

_MOST_BEHIND = 128
"""Samples that the fallbacks may owe: enough for the cost to vanish, few enough to be made up for in a millisecond."""


class FallbackState(NamedTuple):
    """What a :class:`FallbackTracker` rests on, for another of the same model."""

    voices: tuple[Snapshot | None, ...]
    """The main estimator's, then each fallback's; None for one that has not begun."""
    speaking: int
    """Which of them was last heard."""
    difference_degC: float
    said_degC: float | None
    said_s: float
    background: "Background | None" = None
    """Of a model with a guard or a spread."""


class _Voice:
    """An estimator at work, fed from the readings of all the model's inputs."""

    def __init__(self, model: Model, estimator: Estimator, period_s: float, level: int, coast_s: float | None) -> None:
        self.tracker = Tracker(estimator, nearest_discrete(estimator, period_s), level, coast_s)
        self._picks = [model.main.inputs.index(each) for each in estimator.inputs]
        self._width = len(model.main.inputs)

    def update(self, time_s: float, readings: Readings) -> Estimate:
        return self.tracker.update(time_s, [readings[index] for index in self._picks])

    def follow(self, samples: list[tuple[float, list[float]]]) -> None:
        """Take samples that the main estimator has found complete and in their ranges, which are the same here."""
        for time_s, readings in samples:
            self.tracker.follow(time_s, [readings[index] for index in self._picks])

    def used(self, estimate: Estimate) -> tuple[float | None, ...]:
        """What it used, per input of the model: None for the one that it does without."""
        values: list[float | None] = [None] * self._width
        for index, value in zip(self._picks, estimate.used):
            values[index] = value
        return tuple(values)


class FallbackTracker:
    """A model's main estimator and its fallbacks, fed one sample at a time; the interval is that of ``level`` percent.

    Guard and spread are the main estimator's: where a fallback speaks, its own interval holds.

    ``period_s`` is how far apart the samples will lie. Two missing inputs leave no fallback: the main one coasts, for
    ``coast_s`` or, where that is None, as long as a gap is bridged.
    """

    def __init__(self, model: Model, period_s: float, level: int = 90, coast_s: float | None = None) -> None:
        self._main = _Voice(model, model.main, period_s, level, coast_s)
        self._observer = _observer(model, self._main.tracker, level, coast_s)
        self._hear = self._main.tracker.update if self._observer is None else self._observer.update
        self._fallbacks = [_Voice(model, each, period_s, level, coast_s) for each in model.fallbacks.values()]
        self.period_s = self._main.tracker.discrete.period_s
        self.limit_s = bridge_limit_s(self.period_s)
        settling_steps = max(voice.tracker.settling_steps for voice in (self._main, *self._fallbacks))
        # down to 5 % when the slowest has settled; a static model has no time of its own
        self._fading_s = max(self.limit_s, settling_steps * self.period_s / 3)
        self._behind: list[tuple[float, list[float]]] = []
        self._speaking = self._main
        self._difference_degC = 0.0
        self._said_degC: float | None = None
        self._said_s = 0.0

    @property
    def _voices(self) -> list[_Voice]:
        return [self._main, *self._fallbacks]

    @property
    def _settled(self) -> bool:
        """Whether the main one has, which its status leaves open where its guard has a say."""
        return self._main.tracker.step >= self._main.tracker.settling_steps

    def _make_up(self) -> None:
        for voice in self._fallbacks:
            voice.follow(self._behind)
        self._behind = []

    def snapshot(self) -> FallbackState:
        """What it rests on, for :meth:`restore`."""
        self._make_up()
        return FallbackState(
            tuple([voice.tracker.snapshot() for voice in self._voices]),
            self._voices.index(self._speaking),
            self._difference_degC,
            self._said_degC,
            self._said_s,
            None if self._observer is None else self._observer.background(),
        )

    def restore(self, state: FallbackState) -> None:
        """Go on from ``state``; raises ValueError, and changes nothing, where it is of another model or period."""
        voices = self._voices
        if len(state.voices) != len(voices) or not 0 <= state.speaking < len(voices):
            raise ValueError("it has other estimators")
        pairs = [(voice.tracker, snapshot) for voice, snapshot in zip(voices, state.voices) if snapshot is not None]
        if not all([tracker.fits(snapshot) for tracker, snapshot in pairs]):
            raise ValueError("it has another period or shape")
        main, background = state.voices[0], state.background
        if (self._observer is None) != (background is None):
            raise ValueError("it has other estimators")
        if main is not None and self._observer is not None and background is not None:
            if not self._observer.fits(main, background):
                raise ValueError("it has another guard or spread")
            self._observer.restore(main, background)
        self._make_up()
        for tracker, snapshot in pairs:
            tracker.restore(snapshot)
        self._speaking = voices[state.speaking]
        self._difference_degC, self._said_degC, self._said_s = state[2:5]

    def update(self, time_s: float, readings: Readings) -> Estimate:
        """The estimate at ``time_s`` from one reading per input of the model (degC, A, ...; None where missing)."""
        main = self._hear(time_s, readings)
        if not self._fallbacks:
            return main
        if has_all_inputs(main.status) and (self._speaking is self._main or self._settled):
            self._behind.append((time_s, self._main.tracker.last))
            if len(self._behind) >= _MOST_BEHIND:
                self._make_up()
            if self._speaking is self._main and self._difference_degC == 0:  # nothing is left to fade
                self._said_degC, self._said_s = main.ambient_degC, time_s
                return main
            return self._say(time_s, self._main, main)
        self._make_up()
        others = [(voice, voice.update(time_s, readings)) for voice in self._fallbacks]
        return self._say(time_s, *self._choose(main, others))

    def _say(self, time_s: float, voice: _Voice, estimate: Estimate) -> Estimate:
        """What is published of what ``voice`` says."""
        ambient, low, high, status, used = estimate
        if ambient is None or low is None or high is None:
            self._speaking, self._said_degC = voice, None
            return estimate
        self._difference_degC = difference = self._bridge(time_s, voice, ambient)
        self._speaking, self._said_degC, self._said_s = voice, ambient + difference, time_s
        # the interval holds both ends of the bridge
        return Estimate(
            self._said_degC,
            low + min(0.0, difference),
            high + max(0.0, difference),
            status,
            used if voice is self._main else voice.used(estimate),
        )

    def _choose(self, main: Estimate, others: list[tuple[_Voice, Estimate]]) -> tuple[_Voice, Estimate]:
        """Who speaks where the main one lacks an input, or lacked one and has not settled since."""
        own = WARMING_UP if has_all_inputs(main.status) else main.status
        heard = self._voices.index(self._speaking)
        number, status = decide(own, [estimate.status for _, estimate in others], heard)
        if number == MAIN:
            return self._main, main
        voice, estimate = others[number - 1]
        return voice, estimate._replace(status=status)

    def _bridge(self, time_s: float, voice: _Voice, ambient_degC: float) -> float:
        """What is to be added to ``ambient_degC``, which ``voice`` has at ``time_s``."""
        passed_s = time_s - self._said_s
        if self._said_degC is None or not 0 <= passed_s <= self.limit_s:
            return 0.0
        if voice is not self._speaking:
            return self._said_degC - ambient_degC
        return self._difference_degC * math.exp(-passed_s / self._fading_s)


def _observer(model: Model, main: Tracker, level: int, coast_s: float | None) -> "Observer | None":
    """What weighs the main estimator's word, where the model has any such thing."""
    if model.guard is None and model.spread is None:
        return None
    from ambient_model.observer import Observer

    return Observer(model, main, level, coast_s)
