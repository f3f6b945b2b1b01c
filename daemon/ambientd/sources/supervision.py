"""Plausibility of readings: rules for retrying, and for what is stuck, jumps or leaves its range.

It knows no clock: time comes in as an argument. An implausible reading is a missing value.
"""

from collections.abc import Sequence
from typing import NamedTuple

from ambient_model.model import Input

_FIRST_WAIT_S = 1.0
_LONGEST_WAIT_S = 32.0
_FORGET_S = 2 * _LONGEST_WAIT_S
_MOVED_K = 2.0
_CALM_S = 10.0
_UNWATCHED_S = 60.0
"""No rate is this slow: longer pauses are not observed, as in a suspend."""
_UNITS = {1000.0: "degrees", 100.0: "tenths of a degree"}
_PLAUSIBLE_DEGC = (5.0, 130.0)
_ALL_BELOW_DEGC = _PLAUSIBLE_DEGC[1] / 1000
_APART_K, _NEAR_K = 5.0, 40.0
"""How far apart the temperatures of one device may lie, and must not."""


class Rules(NamedTuple):
    """What makes a temperature implausible; None is off, as a quiet device is neither stuck nor broken."""

    stuck_after_s: float | None = None
    """A reading that stands still for longer than this, while at least half of the other temperatures moved by 2 K."""
    stuck_within_K: float = 0.0
    """How far from where it began a reading still stands still: 0 is exactly the same reading."""
    jump_K_per_s: float | None = None
    """More than this between two readings (less than a second apart counts as a second), until 10 s are calm."""


class BackOff:
    """When to try again what failed: at once, at the next moment, then 1, 2, 4 ... 32 s apart.

    After 64 s without need it starts again.
    """

    def __init__(self) -> None:
        self._due_s: float | None = None
        self._wait_s = 0.0

    def due(self, now_s: float) -> bool:
        """Whether to try now; if so, the next time is set."""
        if self._due_s is not None and now_s < self._due_s:
            return False
        if self._due_s is None or now_s >= self._due_s + _FORGET_S:
            self._wait_s = 0.0
        self._due_s = now_s + self._wait_s
        self._wait_s = min(max(_FIRST_WAIT_S, 2 * self._wait_s), _LONGEST_WAIT_S)
        return True


def outside(given: Input, value: float) -> str:
    """Why ``value`` is no reading of ``given``; empty where it lies in its range."""
    if given.min <= value <= given.max:
        return ""
    return f"{value:g} {given.unit} is outside {given.min:g} to {given.max:g}"


def wrong_unit(value_degC: float, all_degC: Sequence[float]) -> str:
    """Why a temperature is in another unit than the kernel's millidegrees; empty where it is not.

    In that unit it would be plausible and near the largest of all, and as it is it lies far below; or all are so small.
    """
    largest_degC = max(all_degC)
    for factor, unit in _UNITS.items():
        scaled_degC = value_degC * factor
        apart = largest_degC - value_degC > _APART_K and abs(scaled_degC - largest_degC) <= _NEAR_K
        if _PLAUSIBLE_DEGC[0] <= scaled_degC <= _PLAUSIBLE_DEGC[1] and (apart or largest_degC < _ALL_BELOW_DEGC):
            return f"reports {unit}: {scaled_degC:g} degC taken for {value_degC:g}"
    return ""


class Supervision:
    """Checks the temperatures among a model's inputs, sample by sample."""

    def __init__(self, inputs: Sequence[Input], rules: Rules) -> None:
        self._temperatures = [index for index, each in enumerate(inputs) if each.unit == "degC"]
        self._inputs = inputs
        after_s, within_K, limit_K_per_s = rules
        self._stuck = None if after_s is None else _Stuck(len(self._temperatures), after_s, within_K)
        self._jumps = [] if limit_K_per_s is None else [_Jump(limit_K_per_s) for _ in self._temperatures]
        self.watches = after_s is not None or limit_K_per_s is not None
        """Whether any rule is on."""

    def doubts(self, now_s: float, values: Sequence[float | None]) -> dict[int, str]:
        """Why some of ``values`` (one per input, None where missing) are implausible, per index."""
        reasons: dict[int, str] = {}
        for index, jump in zip(self._temperatures, self._jumps):
            reason = jump.reason(now_s, values[index])
            if reason:
                reasons[index] = reason
        if self._stuck is not None:
            # an implausible one is no evidence against the others
            evidence = [None if index in reasons else self._in_range(index, values) for index in self._temperatures]
            found = self._stuck.reasons(now_s, evidence)
            reasons.update((self._temperatures[place], reason) for place, reason in found.items())
        return reasons

    def in_wrong_units(self, values: Sequence[float | None]) -> dict[int, str]:
        """Which of the temperatures among ``values`` are in another unit than the kernel's, per index, and why."""
        known = [(index, value) for index in self._temperatures if (value := values[index]) is not None]
        all_degC = [value for _, value in known]
        return {index: why for index, value in known if (why := wrong_unit(value, all_degC))}

    def _in_range(self, index: int, values: Sequence[float | None]) -> float | None:
        value = values[index]
        return None if value is None or outside(self._inputs[index], value) else value


class _Jump:
    """One temperature and the rate that it can't exceed."""

    def __init__(self, limit_K_per_s: float) -> None:
        self._limit_K_per_s = limit_K_per_s
        self._last: tuple[float, float] | None = None
        self._calm_s: float | None = None
        """When it is plausible again, where it is not."""
        self._reason = ""

    def reason(self, now_s: float, value: float | None) -> str:
        if value is None:
            return ""
        before, self._last = self._last, (now_s, value)
        if before is not None:
            passed_s = max(1.0, now_s - before[0])
            if abs(value - before[1]) > self._limit_K_per_s * passed_s:
                self._calm_s = now_s + _CALM_S
                self._reason = f"jumped from {before[1]:g} to {value:g} degC"
        if self._calm_s is not None and now_s >= self._calm_s:
            self._calm_s, self._reason = None, ""
        return self._reason


class _Stand(NamedTuple):
    """A temperature that stands still."""

    since_s: float
    value: float
    beside: list[float | None]
    """All temperatures when it began to, or when they first came."""
    moved: set[int]
    """Which of them have moved since."""


class _Stuck:
    """Some temperatures, and how long one may stand still while the others move."""

    def __init__(self, count: int, after_s: float, within_K: float) -> None:
        self._after_s = after_s
        self._within_K = within_K
        self._stands: list[_Stand | None] = [None] * count
        self._stuck: set[int] = set()
        self._last_s = 0.0

    def reasons(self, now_s: float, values: Sequence[float | None]) -> dict[int, str]:
        reasons = {}
        if now_s - self._last_s > _UNWATCHED_S:
            self._stands = [each if index in self._stuck else None for index, each in enumerate(self._stands)]
        self._last_s = now_s
        for index, (value, stand) in enumerate(zip(values, self._stands)):
            if value is None:
                continue
            if stand is None or abs(value - stand.value) > self._within_K:
                self._stands[index] = _Stand(now_s, value, list(values), set())
                self._stuck.discard(index)
                continue
            self._note_moves(stand, values)
            others = sum(before is not None for before in stand.beside) - 1
            if now_s - stand.since_s > self._after_s and 0 < others <= 2 * len(stand.moved):
                reasons[index] = f"stands at {value:g} degC while others move"
                self._stuck.add(index)
        return reasons

    def _note_moves(self, stand: _Stand, values: Sequence[float | None]) -> None:
        for other, (before, value) in enumerate(zip(stand.beside, values)):
            if before is None:
                stand.beside[other] = value
            elif value is not None and abs(value - before) >= _MOVED_K:
                stand.moved.add(other)
