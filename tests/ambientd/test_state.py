"""What was estimated goes on over a restart, and only from a file that this daemon wrote for this model just now."""

import contextlib
import hashlib
import json
import math
import os
import signal

import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from ambient_model.error_variance import VarianceState
from ambient_model.observer import Background
from ambient_model.tracking import Snapshot
from ambientd.config import StateSpec
from ambientd.fallback import FallbackState, FallbackTracker
from ambientd.state import State, StateFile, decode, encode, model_identity, take_back
from documents import damaged


def rows(count, start=0):
    return [(float(k), (30 + 5 * math.sin(k / 30), 25 + 3 * math.cos(k / 20))) for k in range(start, start + count)]


def fed(tracker, samples):
    return [tracker.update(*sample) for sample in samples]


@pytest.mark.parametrize(
    ("given", "taker", "reason"),
    [
        ({}, ({"fallbacks": True}, 1.0), "it has other estimators"),
        ({}, ({}, 0.5), "it has another period or shape"),
        ({"guarded": True}, ({}, 1.0), "it has other estimators"),
        ({}, ({"guarded": True}, 1.0), "it has other estimators"),
    ],
)
def test_another_models_state_is_refused_and_changes_nothing(make_model, given, taker, reason):
    tracker, other = FallbackTracker(make_model(**given), 1.0), FallbackTracker(make_model(**taker[0]), taker[1])
    fed(tracker, rows(10))
    fed(other, rows(11))
    before = other.snapshot()
    with pytest.raises(ValueError, match=reason):
        other.restore(tracker.snapshot())
    assert other.snapshot() == before


@pytest.mark.parametrize(
    ("part", "wrong"),
    [
        ("secondary", None),
        *[("secondary", each) for each in ({"step": 8}, {"start_s": 0.5}, {"period_s": 0.1}, {"x": (1.0, 2.0)})],
        ("variance", None),
        *[("variance", each) for each in ({"means_degC": (1.0,)}, {"squares_degC2": (1.0, 2.0)})],
        ("variance", {"squares_degC2": (1.0, -2.0, 3.0)}),
    ],
)
def test_a_background_of_another_model_or_moment_is_refused(make_model, part, wrong):
    model = make_model(guarded=True)
    tracker, other = FallbackTracker(model, 1.0), FallbackTracker(model, 1.0)
    fed(tracker, rows(10))
    state = tracker.snapshot()
    changed = None if wrong is None else getattr(state.background, part)._replace(**wrong)
    with pytest.raises(ValueError, match="it has another secondary estimator or error variance"):
        other.restore(state._replace(background=state.background._replace(**{part: changed})))
    assert other.snapshot().snapshots == (None,)


@pytest.mark.parametrize("without", [None, "secondary", "error_variance"])
@pytest.mark.parametrize("at", [1, 7, 150, 300, 750])
def test_all_goes_on_to_the_bit_where_it_stood(make_model, without, at):
    """Secondary estimator and variance, and at last while the main estimator is waited for."""
    model = make_model(fallbacks=True, guarded=True)._replace(**({without: None} if without else {}))
    whole, first, second = (FallbackTracker(model, 1.0) for _ in range(3))
    samples = [*rows(400), *((time_s, (None, 25.0)) for time_s, _ in rows(300, 400)), *rows(300, 700)]
    wanted = fed(whole, samples)
    blended = without != "secondary"
    assert len({each.status for each in wanted[:400]}) == 2 + blended, "the secondary estimator has a say at times"
    assert [each.used[0] is None for each in wanted[700:]] == [True] * 120 + [False] * 180
    fed(first, samples[:at])
    second.restore(decode(encode(State("model", "boot", 99.0, first.snapshot()))).tracker)
    assert fed(second, samples[at:]) == wanted[at:]


@pytest.fixture
def settled(make_model):
    tracker = FallbackTracker(make_model(fallbacks=True), 1.0)
    fed(tracker, rows(100))
    return tracker


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"model": "other"}, "it is of another model"),
        ({"boot": "other"}, "it is of another boot"),
        ({"now_s": 129.5}, "it is 30 s old, and 30 s are allowed"),
        ({"now_s": 98.0}, "it is -1 s old, and 30 s are allowed"),
        ({"now_s": 105.0, "max_age_s": 5.0}, "it is 6 s old, and 5 s are allowed"),
        ({"boot": ""}, "the system does not identify this boot"),
    ],
)
def test_what_may_not_be_believed_is_not(make_model, settled, change, reason):
    tracker = FallbackTracker(make_model(fallbacks=True), 1.0)
    call = {"model": "model", "boot": "boot", "now_s": 99.0, "max_age_s": 600.0, **change}
    with pytest.raises(ValueError, match=f"^{reason}$"):
        take_back(State("model", "boot", 99.0, settled.snapshot()), tracker, **call)
    assert tracker.snapshot().snapshots == (None,) * 3


ONE = Snapshot(1.0, 0.0, 3, (1.0,), (2.0,))
WHOLE = encode(
    State("m", "b", 5.0, FallbackState((ONE, None), 0, 0.0, 1.5, 3.0, Background(ONE, VarianceState((1.0,), (2.0,)))))
)


def sealed(line):
    """``line`` with the digest that says that it is whole."""
    return line + b"\n" + hashlib.sha256(line).hexdigest().encode() + b"\n"


CHANGED = damaged(json.loads(WHOLE.splitlines()[0])).map(lambda data: sealed(json.dumps(data).encode()))


@given(content=st.binary() | CHANGED | st.binary().map(sealed))
@example(content=sealed(b"[" * 100_000))
@example(content=sealed(b"9" * 5000))
@example(content=sealed(b'{"format": "ambientd-state"}'))
@settings(max_examples=300)
def test_any_bytes_are_a_state_or_a_reason(content):
    with contextlib.suppress(ValueError):
        state = decode(content)
        assert decode(encode(state)) == state
        assert all([abs(each) <= 1e12 for each in state.tracker[2:5] if each is not None])


NUMBERS = st.floats(-1e12, 1e12)


@given(
    x=st.lists(NUMBERS, min_size=2, max_size=2),
    u=st.lists(NUMBERS, min_size=2, max_size=2),
    start_s=NUMBERS,
    step=st.integers(0, 10**12),
    difference=NUMBERS,
    said=st.none() | NUMBERS,
)
@settings(max_examples=100, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_a_state_of_any_numbers_makes_finite_estimates(make_model, x, u, start_s, step, difference, said):
    tracker = FallbackTracker(make_model(fallbacks=True), 1.0)
    voices = (Snapshot(1.0, start_s, step, tuple(x), tuple(u)), None, None)
    tracker.restore(decode(encode(State("m", "b", 99.0, FallbackState(voices, 0, difference, said, 98.0)))).tracker)
    for time_s, values in [*rows(3, 99), (102.0, (None, None)), (140.0, (None, 25.0))]:
        assert all(value is None or math.isfinite(value) for value in tracker.update(time_s, values)[:3])


@pytest.fixture
def state_file(make_model, tmp_path):
    notes = []
    model = make_model(fallbacks=True)
    path = tmp_path / "state"
    return StateFile(StateSpec(str(path), 30.0), model_identity(model), notes.append), notes, path


def test_a_tracker_that_never_began_leaves_no_state(state_file, make_model):
    file, _, path = state_file
    file.close()
    file.ticked(FallbackTracker(make_model(fallbacks=True), 1.0), 5.0)
    file.close()
    assert not path.exists()


def test_a_first_start_says_nothing_and_a_folder_is_told(state_file, settled):
    file, notes, path = state_file
    file.take_back(settled, 5.0)
    assert notes == []
    path.mkdir()
    file.take_back(settled, 5.0)
    file.ticked(settled, 5.0)
    file.ticked(settled, 50.0)
    assert notes == [
        f"state {path}: cannot be read (Is a directory); starting anew",
        f"state {path}: cannot be written (Is a directory); the rest goes on",
    ]


def test_a_restarted_daemon_goes_on_with_the_estimate(start, until, ended, configure, status, phone, tmp_path):
    """The lag on usb is 40 s: what starts anew says the new equilibrium, what goes on is still near the old value."""
    config = configure(publish=[f"status:{tmp_path}/status"], state={"path": "state", "max_age_s": 20})
    first = start("run", "--config", config)
    until(lambda: status().get("ambient_degC") == pytest.approx(23.0))
    began_s = status()["time_s"]
    until(lambda: status()["time_s"] > began_s + 0.2)  # within the first period it would start anew
    _, _, log = ended(first, signal.SIGTERM)
    assert len(log.splitlines()) == 1
    (phone.root / "class/thermal/thermal_zone10/temp").write_text("40000\n")
    second = start("run", "--config", config)
    until(status)
    said = status()["ambient_degC"]
    _, _, log = ended(second)
    assert log.splitlines()[0].startswith(f"ambientd: state {tmp_path}/state: continuing from ")
    # usb counts at once: 23 + 10, and is drawn from with its lag; anew it would be 23 + 0.2 * 10 = 25
    assert 30 < said <= 33.0


def test_it_is_saved_every_so_often_and_at_the_end(state_file, settled):
    file, notes, path = state_file
    saved = []
    for now_s in range(100, 125):
        file.ticked(settled, float(now_s))
        saved.append(decode(path.read_bytes()).time_s)
    file.close()
    assert saved == [100.0] * 10 + [110.0] * 10 + [120.0] * 5
    assert decode(path.read_bytes()).time_s == 124.0
    assert (os.listdir(path.parent), notes) == (["state"], [])
