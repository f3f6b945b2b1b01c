"""The state file, by which the estimate continues over a restart of the daemon, and when it is accepted.

It is accepted only as this daemon wrote it, whole, in this boot (no clock measures how long a device was off), for this
very model, and up to an age. Anything else is ignored with one line in the log. Time is the clock of the samples, which
counts from boot and through suspend. The unit's offset needs only the same model: it outlives a boot, at any age.
"""

import math
import os
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

from ambient_model.faults import Refused
from ambient_model.intake import read_whole
from ambient_model.model import Model
from ambient_model.tracking import Snapshot
from ambientd.fallback import FallbackState, FallbackTracker
from ambientd.json_text import json_text
from ambientd.notices import Notice
from ambientd.publish.claims import open_own
from ambientd.publish.swap import swap_in, sweep
from ambientd.settings import StateSpec

if TYPE_CHECKING:
    from ambient_model.error_variance import VarianceState
    from ambient_model.observer import Background
    from ambient_model.validation import ValidationState
    from ambientd.reference import LastReference, OffsetLearner, OffsetMemory

FORMAT = "ambientd-state"
VERSION = 2
_BOOT_ID = "/proc/sys/kernel/random/boot_id"
LARGEST_BYTES = 2**16
_LARGEST_NUMBER = 1e12
_SAVES_PER_MAX_AGE = 3
for _name in ("_sha2", "_sha256", "hashlib"):  # hashlib brings OpenSSL's 4 MB into a process of 10 MB
    try:  # once: a module that is absent is looked for in every folder
        _digest = __import__(_name).sha256
        break
    except ImportError:
        pass


class State(NamedTuple):
    """State of a tracker at one time of one boot."""

    model: str
    """Its identity: see :func:`model_identity`."""
    boot: str
    time_s: float
    tracker: FallbackState
    offset: "OffsetMemory | None" = None
    """The unit's, where it is learnt."""


def model_identity(model: Model) -> str:
    """The SHA-256 of the model's canonical text: layout and name of its file do not count."""
    from ambient_model.codec import encode as encode_model

    return _sha256(encode_model(model).encode())


def _sha256(content: bytes) -> str:
    return str(_digest(content).hexdigest())


def boot_identity() -> str:
    """What names this boot; empty where the system has none."""
    try:
        with open(_BOOT_ID, encoding="ascii") as stream:
            return stream.read(64).strip()
    except (OSError, ValueError):
        return ""


def encode(state: State) -> bytes:
    """One line of JSON, and one with its SHA-256."""
    model, boot, time_s, tracker, offset = state
    snapshots, active, difference_degC, last_degC, last_s, background = tracker
    data: dict[str, Any] = {
        "format": FORMAT,
        "version": VERSION,
        "model": model,
        "boot": boot,
        "time_s": time_s,
        "snapshots": [each and each._asdict() for each in snapshots],
        "active": active,
        "difference_degC": difference_degC,
        "last_degC": last_degC,
        "last_s": last_s,
    }
    if background is not None:
        secondary, variance, validation = background
        held = {"secondary": secondary, "variance": variance}
        data["background"] = {name: each and each._asdict() for name, each in held.items()}
        if validation is not None:
            data["background"]["readings"] = validation._asdict()
    if offset is not None:
        data["offset"] = {**offset._asdict(), "last": offset.last and offset.last._asdict()}
    line = json_text(data).encode()
    return b"%s\n%s\n" % (line, _sha256(line).encode())


def decode(content: bytes) -> State:
    """The state in ``content``; raises ValueError where it is not whole."""
    line, newline, rest = content.partition(b"\n")
    if not newline or rest != _sha256(line).encode() + b"\n":
        raise ValueError("it is damaged")
    import json  # only where there is a state to go on from

    try:
        return _state(json.loads(line))
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
        raise ValueError("it is of another version") from error


def _state(data: Any) -> State:
    if (data.pop("format"), data.pop("version")) != (FORMAT, VERSION):
        raise ValueError
    last_degC, background = data.pop("last_degC"), data.pop("background", None)
    tracker = FallbackState(
        tuple([None if each is None else _snapshot(**each) for each in data.pop("snapshots")]),
        _count(data.pop("active")),
        _number(data.pop("difference_degC")),
        None if last_degC is None else _number(last_degC),
        _number(data.pop("last_s")),
        None if background is None else _background(background),
    )
    offset = data.pop("offset", None)
    state = State(
        _text(data.pop("model")),
        _text(data.pop("boot")),
        _number(data.pop("time_s")),
        tracker,
        None if offset is None else _offset(**offset),
    )
    if data:
        raise ValueError
    return state


def _background(data: Any) -> "Background":
    from ambient_model.observer import Background

    secondary, variance, validation = data.pop("secondary"), data.pop("variance"), data.pop("readings", None)
    if data:
        raise ValueError
    return Background(
        None if secondary is None else _snapshot(**secondary),
        None if variance is None else _variance(**variance),
        None if validation is None else _validation(**validation),
    )


def _validation(time_s: Any, used: Any, lows: Any, slow: Any, steps: Any, refused: Any) -> "ValidationState":
    from ambient_model.validation import ValidationState

    lists = [tuple([_number(each) for each in values]) for values in (used, lows, slow, steps)]
    pairs = tuple([(_count(i), _number(value)) for i, value in refused])
    return ValidationState(_number(time_s), lists[0], lists[1], lists[2], lists[3], pairs)


def _variance(means_degC: Any, squares_degC2: Any) -> "VarianceState":
    from ambient_model.error_variance import VarianceState

    means, squares = (tuple([_number(each) for each in values]) for values in (means_degC, squares_degC2))
    return VarianceState(means, squares)


def _snapshot(period_s: Any, start_s: Any, step: Any, x: Any, u: Any) -> Snapshot:
    return Snapshot(
        _number(period_s),
        _number(start_s),
        _count(step),
        tuple([_number(each) for each in x]),
        tuple([_number(each) for each in u]),
    )


def _offset(
    offset_degC: Any,
    variance_degC2: Any,
    unix_s: Any,
    counted_unix_s: Any,
    last: Any,
    sensors_degC: Any = (),
    seen: Any = 0,
    taken_off_degC: Any = (),
) -> "OffsetMemory":
    from ambientd.reference import OffsetMemory

    numbers = [_number(each) for each in (offset_degC, variance_degC2, unix_s, counted_unix_s)]
    sensors, taken_off = (tuple([_number(each) for each in values]) for values in (sensors_degC, taken_off_degC))
    reference = None if last is None else _last(**last)
    return OffsetMemory(numbers[0], numbers[1], numbers[2], numbers[3], reference, sensors, _count(seen), taken_off)


def _last(unix_s: Any, degC: Any, sigma_degC: Any, counted: Any, outcome: Any) -> "LastReference":
    from ambientd.reference import LastReference

    value, sigma = (None if each is None else _number(each) for each in (degC, sigma_degC))
    return LastReference(_number(unix_s), value, sigma, counted is True, _text(outcome))


def _text(value: Any) -> str:
    if not isinstance(value, str):
        raise TypeError
    return value


def _number(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not abs(value) <= _LARGEST_NUMBER:
        raise TypeError
    return float(value)


def _count(value: Any) -> int:
    if type(value) is not int or not 0 <= value <= _LARGEST_NUMBER:
        raise TypeError
    return value


def take_back(state: State, tracker: FallbackTracker, model: str, boot: str, now_s: float, max_age_s: float) -> float:
    """Restore ``tracker`` from ``state`` and return the state's age in s; raises ValueError, with the reason, and then
    leaves it unchanged.
    """
    if state.model != model:
        raise ValueError("it is of another model")
    if not boot or state.boot != boot:
        raise ValueError("it is of another boot" if boot else "the system does not identify this boot")
    age_s = now_s - state.time_s
    limit_s = min(max_age_s, tracker.limit_s)
    if not 0 <= age_s <= limit_s:
        raise ValueError(f"it is {age_s:.0f} s old, and {limit_s:g} s are allowed")
    tracker.restore(state.tracker)
    return age_s


class StateFile:
    """The state of the model ``identity`` in one file. ``note`` takes a message where it is restored, or fails.

    What ``learner`` holds goes along, where there is one.
    """

    def __init__(
        self, spec: StateSpec, identity: str, note: Callable[[str], None], learner: "OffsetLearner | None" = None
    ) -> None:
        self._learner = learner
        self._path, self._max_age_s, self._access = spec
        self._model = identity
        self._boot = boot_identity()
        self._note = note
        self._notice = Notice()
        self._saved_s = -math.inf
        self._last: tuple[FallbackTracker, float] | None = None
        sweep(self._path)

    def take_back(self, tracker: FallbackTracker, now_s: float) -> None:
        """Restore ``tracker`` from the file, where that is accepted."""
        if not os.path.lexists(self._path):
            return
        try:
            os.close(open_own(self._path, self._access.owner))
            content = read_whole(self._path, LARGEST_BYTES)
            state = decode(content)
            if self._learner is not None and state.offset is not None and state.model == self._model:
                self._learner.restore(state.offset, now_s)
            age_s = take_back(state, tracker, self._model, self._boot, now_s, self._max_age_s)
        except Refused as refused:
            self._note(f"state {self._path}: {refused.faults[0].problem}; starting anew")
        except OSError as error:
            self._note(f"state {self._path}: cannot be read ({error.strerror or error}); starting anew")
        except ValueError as error:
            self._note(f"state {self._path}: {error}; starting anew")
        else:
            self._note(f"state {self._path}: continuing from {age_s:.1f} s ago")

    def ticked(self, tracker: FallbackTracker, now_s: float) -> None:
        """Save the state of ``tracker``, fed at ``now_s``, every so often."""
        self._last = (tracker, now_s)
        learner = self._learner
        if now_s - self._saved_s >= self._max_age_s / _SAVES_PER_MAX_AGE or (learner is not None and learner.unsaved):
            self._save(tracker, now_s)

    def close(self) -> None:
        """Save the state of the last tick."""
        if self._last is not None:
            self._save(*self._last)

    def _save(self, tracker: FallbackTracker, now_s: float) -> None:
        self._saved_s = now_s
        learner = self._learner
        offset = None if learner is None else learner.memory(now_s)
        state = State(self._model, self._boot, now_s, tracker.snapshot(), offset)
        if not any(state.tracker.snapshots) and (learner is None or not learner.unsaved):
            return
        problem = ""
        try:
            swap_in(self._path, encode(state), self._access)
        except OSError as error:
            problem = error.strerror or str(error)
        if learner is not None and learner.unsaved and not problem:
            learner.saved()
        if self._notice.changed(now_s, bool(problem)):
            self._note(
                f"state {self._path}: {f'cannot be written ({problem}); the rest goes on' if problem else 'is back'}"
            )
