"""Sensor validation: each reading against its expectation given the others; what is missing or refused is replaced.

z holds the m readings and their low-pass filters L with one or several lags,

    L[k+1] = L[k] + a (u[k] - L[k]),  a = 1 - exp(-T / lag),  L[0] = u[0]

and has the mean mu and the precision matrix P (the inverse covariance) that the model file holds. With K the entries of
z that belong to reading i and to the sensors that are set aside, and R the others, the expectation of reading i is

    E[u_i | z_R] = mu_i - (P_KK^-1 P_KR (z_R - mu_R))_i,  with the covariance P_KK^-1

so that no reading takes part in its own expectation, neither now nor by its past. Its difference d to the expectation
has a gate, and so has d low-pass filtered. Beyond one of them the readings are doubted: they are used, since heat that
training lacks does the same, but the estimate is degraded and its variance grows by the square of d times the DC gain.
So is a reading that stands still while its expectation moves by half its gate.
Refused is what no heat does: a reading that jumps away from its expectation, whose difference turns while the others
hardly move, that stands still to the last bit while its expectation given the moving others goes on, or that at the
start lies far outside it and outside what any start of the training had. It is replaced by its expectation plus the
difference that it had before, which is forgotten with time, and accepted again once it has changed and has agreed with
its expectation for 10 s or periods, and for twice as long each time that it is soon refused again, or once it has been
within its gate for 10 minutes. A start waits for every sensor for as long as a reading is held. Readings in coarser
steps than in training widen the interval, and the estimate is degraded where their rounding adds more to its error
variance than training left. What is missing for a short while moves as the others and its own past predict: of z its
reading alone is unknown then. Several sensors that report at once what drivers give without a value (85, -40, 0 degC),
and have not come there step by step, count as missing: they agree with one another. Where all sensors of fine steps
have read the same for minutes, and far longer than in training, nothing is read any more: the estimate coasts. Time
comes in as an argument; a sample less than half a period early or late counts as one that is due.
"""

import itertools
import math
from collections.abc import Iterable, Sequence
from operator import itemgetter, mul, sub
from typing import NamedTuple

from ambient_model.model import SCORES, Estimator, ReadingModel
from ambient_model.recursion import dot, equilibrium
from ambient_model.tracking import bridge_limit_s

SLOW_S = 600.0
"""Time constant of the low-pass filtered difference: as long as the slowest part of a phone."""
_SHORT_GAP = 0.5
"""A gap up to this share of what is bridged, 15 s or 5 periods, leaves status and interval as they are."""
_STARTING_S = 600.0
_OFFSETS_S = 2 * SLOW_S
"""Slow differences start from 0: so long after a start they hold most of what they will."""
_STARTING_SLACK = 3.0
"""Gates are so much wider until the low-pass filters have left their start, which is an equilibrium."""
_AGREE_S, _AGREE_PERIODS = 10.0, 10
"""Two readings that cross agree for some samples. Files without ``turn`` have the first alone."""
_LONGEST_AGREE_S = 3600.0
_FORGIVEN = 3.0
"""One that is used for so many times its next wait is a good one again, whose readings are wrong now and then."""
_SETTLED_S = SLOW_S
"""A refused reading that has been within its gate for so long is used again, and may still be doubted."""
_SIGMAS = 3.0
_COARSE = (1.0, 0.5)
_ROUNDING = 1 / math.sqrt(12)
"""Standard deviation of the rounding error of steps of 1."""
_CERTAIN_S = 60.0
"""What has read in coarse steps for so long since the start is coarse."""
_COASTING_STD_DEGC = 3.0
_START_K = 5.0
"""At the start a reading may lie so far beyond its gate, as no equilibrium is certain."""
DOUBT_S = 10.0
"""How long a doubt lasts."""
_LOOK_S = DOUBT_S / 2
"""How often what stands still is looked at."""
_FAR = 2.0
_LONGEST_TURN = 2.0
"""After more than so many times ``ReadingModel.jump_s`` no change of a difference is judged."""
_MOST_EXPECTATIONS = 512
_MOST_SETS = 256
"""Ten sensors have no more of any size."""
_FROZEN_S, _FROZEN_SHARE, _FINE_K = 300.0, 3.0, 0.5
"""All sensors of finer steps that stand still for so long, and for so many times as in training, are read no more: in
nine measured logs they did so for 9 s or 3 samples at most."""
SENTINELS_DEGC = (-273.15, -127.0, -40.0, 0.0, 85.0, 125.0, 127.0, 255.0)
"""What drivers and sensors report where they have no value: a stricter gate for what jumps there."""
_PASSING_K, _PASSING_STEPS = 1.0, 5

Sensors = frozenset[int]
"""Some inputs, by their number."""
_NONE: Sensors = frozenset()


class ValidationState(NamedTuple):
    """State of a :class:`Validation`, for another of the same model."""

    time_s: float
    used: tuple[float, ...]
    lows: tuple[float, ...]
    slow: tuple[float, ...]
    steps: tuple[float, ...]
    refused: tuple[tuple[int, float], ...]
    """Per refused sensor its number and the reading that was refused."""


class _Expectation(NamedTuple):
    """E[u_i | others] = constant + weights z, and what is asked of the difference to it."""

    constant: float
    weights: list[float]
    gate: float
    slow_gate: float
    release: float
    std: float


class _Refusal:
    """A sensor that is refused since its reading was ``value`` and ``used`` replaced it."""

    def __init__(self, value: float, used: float, wait_s: float) -> None:
        self.value = value
        self.used = used
        self.wait_s = wait_s
        self.agreed_s = 0.0
        self.changed = False
        self.near_s = self.near_Ks = 0.0
        """How long its difference has been within its gate, and the integral of that difference."""

    def __str__(self) -> str:
        return f"reads {self.value:g} where {self.used:.1f} is expected"

    def agrees(self, value: float, used: float) -> bool:
        """Whether a reading is nearer to what replaces it than to that plus the difference it was refused for."""
        return abs(value - used) <= abs(value - used - (self.value - self.used))


class _Start:
    """What is known while the sensors have not all been there: the last reading of each, and when it was."""

    def __init__(self, time_s: float, refused: dict[int, _Refusal], waits_s: list[float]) -> None:
        self.time_s = time_s
        self.refused = refused
        self.waits_s = waits_s
        self.readings: list[float | None] = [None] * len(waits_s)
        self.read_s = [-math.inf] * len(waits_s)


class Validation:
    """Validates the readings of one model, sample by sample; they are due ``period_s`` apart."""

    def __init__(self, model: ReadingModel, estimator: Estimator, period_s: float) -> None:
        self._model = model
        self._period_s = period_s
        self._limit_s = bridge_limit_s(period_s)
        self._short_s = _SHORT_GAP * self._limit_s
        self._count = count = len(estimator.inputs)
        columns = [[float(row == column) for row in range(count)] for column in range(count)]
        states = [equilibrium(estimator.initial, column) for column in columns]
        first = estimator.discrete[0]
        self.sentinels = [SENTINELS_DEGC if each.unit == "degC" else () for each in estimator.inputs]
        """What is no reading of each."""
        self.gains = [sum(map(mul, first.C[0], x)) + direct for x, direct in zip(states, first.D[0])]
        """DC gain of the estimate per input."""
        low, high = estimator.interval[90]
        self._usual_degC2 = ((high - low) / 2 / SCORES[90]) ** 2
        """Variance of the estimate's error in training."""
        self._steps = [max([step for step in _COARSE if step > each.step], default=0.0) for each in model.sensors]
        """Resolution of each sensor's readings where it is coarser than in training, otherwise 0."""
        self._slack = 1.0
        self.refused: dict[int, _Refusal] = {}
        """The refused sensors by their number."""
        self.variance_degC2 = 0.0
        """What replaced and coarse readings add to the estimate's error variance."""
        self.is_degraded = self.is_coasting = False
        self._first_waits_s = [max(_AGREE_S, _AGREE_PERIODS * period_s if each.turn else 0.0) for each in model.sensors]
        self._waits_s = list(self._first_waits_s)
        """How long each sensor must agree when it is refused next."""
        self._released_s = [-math.inf] * count
        """When each was last accepted again."""
        self._begun = False
        self._start: _Start | None = None
        """Where some sensors are still waited for."""
        self.starts_anew = False
        """Whether the last start was replaced by one at this sample, with more sensors."""
        self._time_s = self._start_s = 0.0
        self._used = [0.0] * count
        self._lows: list[float] = []
        self._slow = [0.0] * count
        """Low-pass filtered difference of each."""
        self._last = [0.0] * count
        """Difference of each at its last accepted reading."""
        self._away_s = [0.0] * count
        """How long each has had no reading."""
        self._gaps_s = [0.0] * count
        """How long before its last reading each had the one before."""
        self._still: list[tuple[float, float, list[float]]] = []
        """Since when each reads the same, the reading, and z at that time."""
        self._z: list[float] = []
        """z at the last sample."""
        self._held: dict[int, list[float]] = {}
        """z where each that is missing for a short while was last there."""
        self._offsets: dict[int, float] = {}
        """Difference of what replaces a reading to its expectation, where one is replaced."""
        self._apart = _NONE
        self._apart_before = _NONE
        """What was set aside at the last sample."""
        self._passed_s = -1.0
        self._doubt_degC2 = 0.0
        self._doubt_s = -math.inf
        """When the readings were last doubted, and what that adds to the variance."""
        self._replaced_degC2 = 0.0
        self.is_usual = False
        """Whether nothing is set aside, missing, coarse or new, so that :mod:`ambient_model.straight` may go on."""
        self._look_s = -math.inf
        """When to look next at what stands still."""
        self.is_frozen = False
        """Whether all readings stand still: what they were is read again and again."""
        self.absent: dict[int, float] = {}
        """What several sensors report at once that have no value, by their number."""
        self._forget()
        stds = [self._expectation(_NONE, i).std for i in range(count)]
        self._tails = [max(each.gate / (_SIGMAS * std), 1.0) for each, std in zip(model.sensors, stds)]
        """How much further than a normal distribution's the differences of each reach."""

    def snapshot(self) -> ValidationState | None:
        """Its state, for :meth:`restore`; None where it has not begun."""
        if not self._begun or self._start is not None:
            return None
        used, lows, slow, steps = [tuple(each) for each in (self._used, self._lows, self._slow, self._steps)]
        refused = tuple([(i, each.value) for i, each in self.refused.items()])
        return ValidationState(self._time_s, used, lows, slow, steps, refused)

    def fits(self, state: ValidationState) -> bool:
        """Whether ``state`` has this one's shapes."""
        lengths = [len(each) for each in (state.used, state.slow, state.steps, state.lows)]
        right = [self._count] * 3 + [len(self._model.mean) - self._count]
        return lengths == right and all(0 <= i < self._count for i, _ in state.refused)

    def restore(self, state: ValidationState) -> None:
        """Continue from ``state``, which :meth:`fits`."""
        self._begun, self._start, self._slack = True, None, 1.0
        self.is_usual, self.is_frozen, self._look_s = False, False, -math.inf
        self._time_s = state.time_s
        z = [*state.used, *state.lows]
        self._still = [(state.time_s, value, z) for value in state.used]
        self._z, self._held = z, {}
        self._start_s = state.time_s - _STARTING_S
        self._used, self._lows, self._slow, self._steps = [list(each) for each in state[1:5]]
        self.refused = {}
        self._forget()
        for i, value in state.refused:
            self.refused[i] = _Refusal(value, self._used[i], self._waits_s[i])
        self._set_apart(frozenset(self.refused))

    def restart(self) -> None:
        """Begin again at the next sample; what is refused stays so."""
        self._begun = False

    def update(self, time_s: float, readings: Sequence[float | None]) -> list[float] | None:
        """One value per input, read or replaced; None where no sensor is left. A missing reading is None."""
        readings = self._without_sentinels(readings)
        passed_s = time_s - self._time_s
        self.starts_anew = self._start is not None
        unread_s = min([away_s for i, away_s in enumerate(self._away_s) if i not in self.refused], default=0.0)
        if not self._begun or not 0 <= passed_s <= self._limit_s or unread_s > self._short_s + self._limit_s:
            self.starts_anew = False
            self._start = _Start(time_s, self.refused, self._waits_s)
        if self._start is not None:
            return self._wait(self._start, time_s, readings)
        self._time_s = time_s
        if abs(passed_s - self._period_s) < 0.5 * self._period_s:
            passed_s = self._period_s
        if passed_s != self._passed_s:
            self._set_passed(passed_s)
        if self._slack > 1 and time_s - self._start_s > _STARTING_S:
            self._slack = 1.0
            self._forget()
            if any([each.start for each in self._model.sensors]):
                # the difference of the start is over
                self._slow = [min(pair, key=abs) for pair in zip(self._slow, self._last)]
        if any(self._steps):
            self._learn_steps(readings)
        z = self._with_lows(readings, passed_s)
        jumped = self._doubted(readings, z, passed_s)
        if jumped:
            self._refuse(jumped, readings)
            for i in jumped:
                z[i] = self._used[i]
        self._note_changes(readings, z)
        if time_s >= self._look_s:
            self._refuse_stuck(readings, z)
            self.is_frozen = self._stands_still()
            self._look_s = self.next_look_s()
        self._follow(readings, z)
        if self.refused:
            self._release(readings, z, passed_s)
        return self._finished(z)

    # Expectations

    def _forget(self) -> None:
        """Compute expectations anew: a resolution or the slack has changed."""
        self._known: dict[tuple[Sensors, int], _Expectation] = {}
        self._current: list[_Expectation] = []
        self._predictions: dict[tuple[Sensors, int], tuple[list[float], float]] = {}
        """Of sensors that are missing for a short while, while the same are set aside."""
        self._limits: tuple[tuple[float, ...], ...] = ()
        """Gates and slow gates while nothing is set aside, where they have been asked for."""
        effects = [step * each.effect_degC for step, each in zip(self._steps, self._model.sensors)]
        self._coarse_degC2 = sum([effect * effect for effect in effects])

    def _expectations(self) -> list[_Expectation]:
        """Each sensor's, given those that are not set aside."""
        if not self._current:
            self._current = [self._expectation(self._apart, i) for i in range(self._count)]
        return self._current

    def _expectation(self, apart: Sensors, i: int) -> _Expectation:
        """Of reading ``i`` given the sensors that are neither ``apart`` nor itself."""
        apart -= {i}
        found = self._known.get((apart, i))
        if found is None:
            if len(self._known) >= _MOST_EXPECTATIONS:
                self._known.clear()
            found = self._known[apart, i] = self._computed(apart, i)
        return found

    def _computed(self, apart: Sensors, i: int) -> _Expectation:
        model, own, step = self._model, self._model.sensors[i], self._steps[i]
        entries, covariances = self._covariances(apart | {i}, i)
        weights = [0.0] * len(model.mean)
        for column in set(range(len(weights))).difference(entries):
            weights[column] = -sum([c * model.precision[row][column] for c, row in zip(covariances, entries)])
        std = math.sqrt(max(covariances[entries.index(i)], 0.0))
        usual_std = self._expectation(_NONE, i).std if apart else std
        wider = self._slack * max(std / usual_std, 1.0) if usual_std > 0 else self._slack
        rounding = _ROUNDING * math.hypot(step, *map(mul, weights, self._steps))
        gate = math.hypot(own.gate * wider, 2 * _SIGMAS * rounding)
        return _Expectation(
            constant=model.mean[i] - dot(weights, model.mean),
            weights=weights,
            gate=gate,
            slow_gate=math.hypot(own.slow_gate * wider, _SIGMAS * rounding),
            release=min(gate / 2, _SIGMAS * math.hypot(std, rounding)),
            std=std,
        )

    def _prediction(self, absent: Sensors, i: int) -> tuple[list[float], float]:
        """Weights of z and standard deviation of reading ``i`` while ``absent`` are missing, whose past is known."""
        found = self._predictions.get((absent, i))
        if found is None:
            precision = self._model.precision
            entries = [*self._entries(self._apart), *sorted(absent)]
            covariances = _solved(self._block(entries), [float(entry == i) for entry in entries])
            weights = [
                -sum([c * precision[row][k] for c, row in zip(covariances, entries)]) for k in range(len(precision))
            ]
            for entry in entries:
                weights[entry] = 0.0
            found = weights, math.sqrt(max(covariances[entries.index(i)], 0.0))
            self._predictions[absent, i] = found
        return found

    def _covariances(self, apart: Sensors, i: int) -> tuple[list[int], list[float]]:
        """The entries of z of the sensors ``apart``, and the covariance of reading i with each given the others."""
        entries = self._entries(apart)
        return entries, _solved(self._block(entries), [float(entry == i) for entry in entries])

    def _entries(self, sensors: Sensors) -> list[int]:
        """The entries of z that belong to them."""
        return [first + i for first in range(0, len(self._model.mean), self._count) for i in sorted(sensors)]

    def _block(self, entries: list[int]) -> list[list[float]]:
        precision = self._model.precision
        return [[precision[row][column] for column in entries] for row in entries]

    def _replacement_degC2(self) -> float:
        """Variance of the estimate's error where the sensors that are set aside have their expectations."""
        variance = 0.0
        for i in self._apart:
            entries, covariances = self._covariances(self._apart, i)
            shares = [self.gains[j] * self._tails[j] * covariances[entries.index(j)] for j in self._apart]
            variance += self.gains[i] * self._tails[i] * sum(shares)
        return max(variance, 0.0)

    def _set_apart(self, apart: Sensors) -> None:
        if apart != self._apart:
            self._apart = apart
            self._current = []
            self._predictions = {}
            # what replaces a reading goes on from where it is
            self._offsets = {}
            self._replaced_degC2 = self._replacement_degC2()

    def usual(self) -> list[tuple[float, list[float], float]]:
        """Constant, weights of z and DC gain of each sensor while nothing is set aside."""
        found = [self._expectation(_NONE, i) for i in range(self._count)]
        return [(each.constant, each.weights, gain) for each, gain in zip(found, self.gains)]

    def slow_differences(self, offsets_degC: Sequence[float]) -> list[float] | None:
        """The low-pass filtered difference of each reading, had these constants not been taken off the readings.

        None where a sensor is set aside or coarser than in training, and until the start has been forgotten.
        """
        if not self._begun or self._apart or any(self._steps) or self._time_s - self._start_s < _OFFSETS_S:
            return None
        offsets = [*offsets_degC] * (len(self._model.mean) // self._count)
        return [
            slow + own - dot(weights, offsets)
            for (_, weights, _), slow, own in zip(self.usual(), self._slow, offsets_degC)
        ]

    def refusals(self) -> dict[int, str]:
        """Why readings are not used, by the sensor's number."""
        frozen = [i for i in range(self._count) if self.is_frozen]
        found = dict.fromkeys(frozen, "stands still to the last bit, as all others do")
        found |= {i: f"reads {value:g}, as sensors do that have no value" for i, value in self.absent.items()}
        return found | {i: str(each) for i, each in self.refused.items()}

    # Samples

    def _without_sentinels(self, readings: Sequence[float | None]) -> Sequence[float | None]:
        """The readings, where several sensors report at once that they have no value as if all of these were missing.

        They agree with one another, so that no expectation shows them to be wrong.
        """
        hits = [i for i, value in enumerate(readings) if value in self.sentinels[i]]
        if self._begun:
            hits = [i for i in hits if not self._passes(i, readings[i] or 0.0)]
        self.absent = {i: readings[i] or 0.0 for i in hits if len(hits) > 1}
        return [None if i in self.absent else value for i, value in enumerate(readings)] if self.absent else readings

    def _wait(self, start: _Start, time_s: float, readings: Sequence[float | None]) -> list[float] | None:
        """Begin again with each sensor's last reading, until all have been there or the rest is missing."""
        for i, value in enumerate(readings):
            if value is not None:
                start.readings[i], start.read_s[i] = value, time_s
        refused = {i: each for i, each in start.refused.items() if start.readings[i] in (None, each.value)}
        missing = [i for i, value in enumerate(start.readings) if value is None and i not in refused]
        if len(missing) == self._count - len(refused):
            self._begun = self.is_usual = False
            return None
        self._waits_s = list(start.waits_s)
        used = self._begin(time_s, start.readings, refused)
        self._away_s = [time_s - read_s for read_s in start.read_s]
        if not missing or time_s - start.time_s >= self._short_s:
            self._start = None
        return used

    def _begin(
        self, time_s: float, readings: Sequence[float | None], refused: dict[int, _Refusal]
    ) -> list[float] | None:
        """Start in equilibrium with the sensors that agree, without those that were ``refused`` and read the same."""
        self._begun, self._time_s, self._start_s, self._look_s = True, time_s, time_s, -math.inf
        self.is_frozen = False
        self._slack, self.refused, self._slow = _STARTING_SLACK, refused, [0.0] * self._count
        self._learn_steps(readings)
        self._forget()
        self._set_passed(0.0)
        self._apart = _NONE
        self._set_apart(frozenset([*refused, *[i for i, value in enumerate(readings) if value is None]]))
        z = [self._model.mean[i] if value is None else value for i, value in enumerate(readings)]
        z *= len(self._model.mean) // self._count
        for i in self._apart:
            value = self._expected(self._apart, i, z)
            z[i :: self._count] = [value] * (len(z) // self._count)
        self._used = z[: self._count]
        present = [i for i in range(self._count) if i not in self._apart]
        wrong = self._inconsistent(z, present)
        self._refuse(wrong, readings)
        for i in self._apart:
            value = self._expected(self._apart, i, z)
            z[i :: self._count] = [value] * (len(z) // self._count)
            if i in wrong:
                self.refused[i].used = value
        self._lows = z[self._count :]
        self._still = [(time_s, value, z) for value in z[: self._count]]
        self._held = {}
        self._last = [0.0] * self._count
        return self._finished(z)

    def _set_passed(self, passed_s: float) -> None:
        self._passed_s = passed_s
        self._a = [-math.expm1(-passed_s / lag_s) for lag_s in self._model.lags_s for _ in range(self._count)]
        self._slow_a = -math.expm1(-passed_s / SLOW_S)
        self._kept = [math.exp(-passed_s / each.memory_s) for each in self._model.sensors]

    def _learn_steps(self, readings: Sequence[float | None]) -> None:
        for i, (value, step) in enumerate(zip(readings, self._steps)):
            if step and value is not None and abs(value / step - round(value / step)) > 1e-6:
                finer = [each for each in _COARSE if self._model.sensors[i].step < each < step]
                self._steps[i] = max(finer, default=0.0)
                self._forget()

    def _with_lows(self, readings: Sequence[float | None], passed_s: float) -> list[float]:
        """z with the readings, and for the missing ones what replaces them."""
        missing = False
        used = list(self._used)
        for i, value in enumerate(readings):
            if value is None:
                self._away_s[i] += passed_s
                missing = True
            else:
                self._gaps_s[i] = self._away_s[i] + passed_s
                self._away_s[i] = 0.0
                if i not in self.refused:
                    used[i] = value
        if missing or self._apart:
            away = [i for i, away_s in enumerate(self._away_s) if away_s > self._short_s]
            self._set_apart(frozenset([*self.refused, *away]))
        return used + self._lows

    def _doubted(self, readings: Sequence[float | None], z: list[float], passed_s: float) -> list[int]:
        """Note how far the readings lie beyond their gates; return those that can't be right."""
        jumped = []
        doubt_degC2 = 0.0
        has_turned = False
        for i, (value, expectation) in enumerate(zip(readings, self._expectations())):
            if value is None or i in self.refused:
                continue
            constant, weights, gate, slow_gate, release, _ = expectation
            d = value - constant - dot(weights, z)
            if not -release <= d <= release:
                if value in self.sentinels[i] and self._still[i][1] != value and not self._passes(i, value):
                    jumped.append(i)
                if not -gate <= d <= gate:
                    doubt_degC2 = max(doubt_degC2, (self.gains[i] * d) ** 2)
            if self._has_jumped(i, value, d):
                jumped.append(i)
            has_turned = has_turned or 0 < self._model.sensors[i].turn < abs(d - self._last[i])
            slow = self._slow[i]
            if not -slow_gate <= slow <= slow_gate:
                doubt_degC2 = max(doubt_degC2, (self.gains[i] * slow) ** 2)
        if doubt_degC2:
            self._doubt_degC2, self._doubt_s = doubt_degC2, self._time_s
        # what jumps moves the expectations of the others
        if has_turned and not jumped and not (self._held or None in readings or any(self._steps)):
            jumped = self._turned(z, passed_s)
        # more than half at once are no fault of a sensor
        if self._count > 2 and len({*jumped}) > self._count / 2:
            return []
        return jumped

    def _passes(self, i: int, value: float) -> bool:
        """Whether it moved so little that it may well be on its way from below to above, or back."""
        step = max(self._steps[i], self._model.sensors[i].step)
        return abs(value - self._used[i]) <= max(_PASSING_K, _PASSING_STEPS * step)

    def _has_jumped(self, i: int, value: float, difference: float) -> bool:
        """Whether it moved further than it can since it was read before, and away from its expectation."""
        limits = self._model.sensors[i]
        moved = abs(value - self._used[i]) - 2 * self._steps[i]
        if moved <= limits.jump:
            return False
        reach = limits.jump * max(self._gaps_s[i] / self._model.jump_s, 1.0)
        # two that jump together are expected to be where they are
        return moved > reach * (1 if abs(difference) > abs(self._last[i]) else _FAR)

    def _turned(self, z: list[float], passed_s: float) -> list[int]:
        """The one whose difference changed by more than it can while the others hardly moved, if there is one."""
        if self._apart != self._apart_before or self._slack > 1 or passed_s > _LONGEST_TURN * self._model.jump_s:
            return []
        sensors, present = self._model.sensors, [i for i in range(self._count) if i not in self._apart]
        moved = list(map(sub, z, self._z))
        # what stands still for long may be stuck, and says nothing of how the others move
        if any([2 * (self._time_s - self._still[i][0]) > sensors[i].still_s for i in present if not moved[i]]):
            return []
        furthest = [max(map(abs, moved[i :: self._count])) for i in range(self._count)]
        beyond = []
        for i in present:
            expectation = self._expectation(self._apart, i)
            turn = sensors[i].turn * expectation.gate / sensors[i].gate
            others = [j for j in present if j != i]
            changed = abs(moved[i] - dot(expectation.weights, moved))
            # what they read before moves its expectation, too
            most = max([furthest[j] for j in others], default=math.inf)
            if 0 < turn < changed - most and all([abs(moved[j]) <= turn for j in others]):
                beyond.append((changed / expectation.std, i))
        return [i for _, i in sorted(beyond)[-1:]]

    def _inconsistent(self, z: list[float], present: Sequence[int]) -> Sensors:
        """The smallest set of sensors without which the others lie within their gates and ``_START_K``.

        Where there are more than ``_MOST_SETS`` of a size, the best of the size before grows by each other sensor.
        """
        best = _NONE
        for size in range(max(len(present) - 1, 1)):
            if math.comb(len(present), size) <= _MOST_SETS:
                sets = [frozenset(each) for each in itertools.combinations(present, size)]
            else:
                sets = [best | {i} for i in present if i not in best]
            ranked = sorted(zip(self._evidence(z, sets), sets), key=itemgetter(0), reverse=True)
            best = ranked[0][1]
            for _, sensors in ranked:
                apart = self._apart | sensors
                kept = [i for i in present if i not in sensors]
                if all(self._begins_right(apart, i, z) for i in kept):
                    return sensors
        # where no others are there, or they do not agree either
        return frozenset([i for i in present if z[i] in self.sentinels[i] and not self._begins_right(_NONE, i, z)])

    def _begins_right(self, apart: Sensors, i: int, z: list[float]) -> bool:
        """Whether a reading at the start lies about where the training began, given those that are not ``apart``."""
        return abs(z[i] - self._expected(apart, i, z)) <= self._beyond(apart, i)

    def _beyond(self, apart: Sensors, i: int) -> float:
        return max(self._expectation(apart, i).gate, self._model.sensors[i].start) + _START_K

    def _evidence(self, z: list[float], sets: Sequence[Sensors]) -> list[float]:
        """Per set of sensors, what leaving out its entries K of z takes off the Mahalanobis distance of z.

        With g = P (z - mu) that is g_K' P_KK^-1 g_K: twice the logarithm of a likelihood ratio.
        """
        centred = [value - mean for value, mean in zip(z, self._model.mean)]
        g = [sum(map(mul, row, centred)) for row in self._model.precision]
        found = []
        for sensors in sets:
            entries = self._entries(sensors)
            solution = _solved(self._block(entries), [g[entry] for entry in entries])
            found.append(sum([g[entry] * value for entry, value in zip(entries, solution)]))
        return found

    def _expected(self, apart: Sensors, i: int, z: list[float]) -> float:
        expectation = self._expectation(apart, i)
        return expectation.constant + dot(expectation.weights, z)

    def _refuse(self, sensors: Iterable[int], readings: Sequence[float | None]) -> None:
        for i in sensors:
            value = readings[i]
            if value is not None and i not in self.refused:
                if self._time_s - self._released_s[i] > _FORGIVEN * self._waits_s[i]:
                    self._waits_s[i] = self._first_waits_s[i]
                self.refused[i] = _Refusal(value, self._used[i], self._waits_s[i])
                self._waits_s[i] = min(2 * self._waits_s[i], _LONGEST_AGREE_S)
        self._slow = [0.0] * self._count
        self._set_apart(self._apart.union(self.refused))

    def _note_changes(self, readings: Sequence[float | None], z: list[float]) -> None:
        for i, (value, still) in enumerate(zip(readings, self._still)):
            if value is not None and value != still[1] and i not in self._apart:
                self._still[i] = (self._time_s, value, z)

    def is_standing(self, time_s: float) -> bool:
        """Whether something may stand still for too long, or the gates of the start are over or near their end."""
        pairs = zip(self._still, self._model.sensors)
        return self._slack > 1 or any([2 * (time_s - still[0]) > each.still_s for still, each in pairs])

    def next_look_s(self) -> float:
        """When something has stood still for long enough to be looked at, or the gates change, and not too soon."""
        stuck_s = min([still[0] + each.still_s / 2 for still, each in zip(self._still, self._model.sensors)])
        look_s = max(stuck_s, self._time_s + _LOOK_S)
        return min(look_s, self._start_s + _STARTING_S) if self._slack > 1 else look_s

    def _refuse_stuck(self, readings: Sequence[float | None], z: list[float]) -> None:
        """Doubt, and after longer refuse, what reads the same to the last bit while its expectation moves."""
        stuck, longest = [], 0.0
        for i, (value, still) in enumerate(zip(readings, self._still)):
            if value is None or i in self._apart or self._steps[i]:
                continue
            share = (self._time_s - still[0]) / self._model.sensors[i].still_s
            if share > 0.5:
                stuck.append(i)
                longest = max(longest, share)
        # two at once are as unlikely after half the time
        long = longest * len(stuck) > 1
        apart = self._apart.union(stuck)
        for i in stuck:
            expectation = self._expectation(apart, i)
            moved = dot(expectation.weights, z) - dot(expectation.weights, self._still[i][2])
            gate = self._expectation(self._apart, i).gate
            # no step is read where many are due: doubted before its difference is as large as heat may make it
            if abs(moved) > max(gate / 2, expectation.std):
                self._doubt_degC2, self._doubt_s = (self.gains[i] * moved) ** 2, self._time_s
            if long and abs(moved) > max(gate, 2 * expectation.std):
                self._refuse([i], readings)
                self.refused[i].used += moved

    def _stands_still(self) -> bool:
        """Whether several sensors of fine steps are there, and have all read the same to the last bit for too long."""
        sensors = self._model.sensors
        left = [i for i in range(self._count) if i not in self._apart]
        fine = [i for i in left if max(self._steps[i], sensors[i].step) < _FINE_K]
        most_s = [max(_FROZEN_S, _FROZEN_SHARE * sensors[i].still_s) for i in fine]
        return len(fine) > 1 and all([self._time_s - self._still[i][0] > most for i, most in zip(fine, most_s)])

    def _follow(self, readings: Sequence[float | None], z: list[float]) -> None:
        """Replace what is missing or refused, and follow the slow differences of the others.

        Where nothing is left its last readings stay: the training's mean says nothing of this device.
        """
        if len(self._apart) == self._count:
            return
        if self._held or None in readings:
            self._move_held(readings, z)
        for i, (value, expectation) in enumerate(zip(readings, self._expectations())):
            if value is None and i not in self._apart:
                continue
            if value is None or i in self._apart:
                expected = expectation.constant + dot(expectation.weights, z)
                offset = self._offsets.get(i, self._used[i] - expected) * self._kept[i]
                self._offsets[i] = offset
                z[i] = expected + offset
                continue
            self._offsets.pop(i, None)
            d = self._last[i] = value - expectation.constant - dot(expectation.weights, z)
            self._slow[i] += self._slow_a * (d - self._slow[i])

    def _move_held(self, readings: Sequence[float | None], z: list[float]) -> None:
        """Move what is missing for a short while as far as the others and its own past predict.

        Where fewer than half are there it keeps its value, and is doubted: what one of them does would move all.
        """
        absent = frozenset([i for i, value in enumerate(readings) if value is None]) - self._apart
        self._held = {i: self._held.get(i, self._z) for i in absent}
        doubt_degC2 = 0.0
        for i, read_z in self._held.items():
            weights, std = self._prediction(absent, i)
            moved = dot(weights, list(map(sub, z, read_z)))
            few = 2 * len(absent | self._apart) > self._count
            z[i] = read_z[i] if few else read_z[i] + moved
            if abs(moved) > std:
                doubt_degC2 = max(doubt_degC2, (self.gains[i] * (moved if few else std)) ** 2)
        if doubt_degC2 > self._usual_degC2:
            recent_degC2 = self._doubt_degC2 if self._time_s - self._doubt_s <= DOUBT_S else 0.0
            self._doubt_degC2, self._doubt_s = max(doubt_degC2, recent_degC2), self._time_s

    def _release(self, readings: Sequence[float | None], z: list[float], passed_s: float) -> None:
        """Accept those again that have agreed with their expectation for long enough."""
        for i, refusal in list(self.refused.items()):
            value = readings[i]
            if value is None:
                continue
            refusal.changed = refusal.changed or value != refusal.value
            expectation = self._expectation(self._apart, i)
            difference = value - expectation.constant - dot(expectation.weights, z)
            agrees = refusal.changed and refusal.agrees(value, z[i])
            if not agrees or abs(difference) > expectation.release:
                refusal.agreed_s = 0.0
            else:
                refusal.agreed_s += passed_s
            if not agrees or abs(difference) > expectation.gate:
                refusal.near_s = refusal.near_Ks = 0.0
            else:
                refusal.near_s += passed_s
                refusal.near_Ks += difference * passed_s
            has_settled = refusal.near_s >= _SETTLED_S
            if refusal.agreed_s >= refusal.wait_s or has_settled:
                del self.refused[i]
                self._released_s[i] = self._time_s
                self._slow = [0.0] * self._count
                if has_settled:
                    self._slow[i] = refusal.near_Ks / refusal.near_s
                # what it read and was replaced by before is no jump, and no standing still
                z[i], self._last[i], self._still[i] = value, difference, (self._time_s, value, z)

    def _finished(self, z: list[float]) -> list[float] | None:
        count = self._count
        self._z = z
        self._apart_before = self._apart
        self._used = used = z[:count]
        self._lows = [low + a * (u - low) for low, a, u in zip(self._lows, self._a, itertools.cycle(used))]
        doubted = self._time_s - self._doubt_s <= DOUBT_S
        replaced_degC2 = self._replaced_degC2 if self._apart else 0.0
        coarse = self._coarse_degC2 > self._usual_degC2 and self._time_s - self._start_s >= _CERTAIN_S
        self.is_degraded = doubted or coarse or bool(self._apart)
        self.is_coasting = self.is_frozen or replaced_degC2 > _COASTING_STD_DEGC**2
        self.variance_degC2 = self._coarse_degC2 + replaced_degC2 + (self._doubt_degC2 if doubted else 0.0)
        odd = self._start or self._apart or self._held or self.is_frozen or any(self._steps)
        self.is_usual = not odd and used == [still[1] for still in self._still]
        if self.is_usual and not self._limits:
            self._limits = tuple(zip(*[each[2:4] for each in self._expectations()]))
        return None if len(self._apart) == count else used


def _solved(matrix: list[list[float]], right: list[float]) -> list[float]:
    """The solution of a symmetric positive definite system, by Gaussian elimination."""
    size = len(right)
    rows = [[*row, value] for row, value in zip(matrix, right)]
    for k in range(size):
        pivot = rows[k]
        for row in rows[k + 1 :]:
            factor = row[k] / pivot[k]
            for column in range(k, size + 1):
                row[column] -= factor * pivot[column]
    x = [0.0] * size
    for k in reversed(range(size)):
        x[k] = (rows[k][size] - sum([rows[k][j] * x[j] for j in range(k + 1, size)])) / rows[k][k]
    return x
