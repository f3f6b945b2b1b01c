"""While one input is away its fallback speaks, and neither taking over nor handing back makes a jump."""

import itertools
import math

import pytest

from ambient_model.tracking import Tracker, nearest_discrete
from ambientd.fallback import FallbackTracker


@pytest.fixture
def tracker(make_model):
    return FallbackTracker(make_model(fallbacks=True), 1.0)


def feed(tracker, rows, start=0):
    return [tracker.update(float(start + k), row) for k, row in enumerate(rows)]


REST = (30.0, 25.0)
"""The main estimator says 0.8 * 25 + 0.2 * 30 - 3 = 23, the one without usb 25 - 5 = 20."""
SETTLING = 120
"""Samples in which the main estimator's lag of 40 s forgets all but 5 %."""


def test_the_fallback_takes_over_where_the_main_one_was_and_fades_to_its_own_value(tracker):
    feed(tracker, [REST] * 200)
    lost = feed(tracker, [(None, 25.0)] * 3000, start=200)
    assert lost[0].ambient_degC == pytest.approx(23.0, abs=1e-9)
    assert {each.status for each in lost} == {"degraded"}
    steps = [b.ambient_degC - a.ambient_degC for a, b in itertools.pairwise(lost)]
    # 3 degC fade with a time constant of settling / 3 = 120 / 3 s: no step above 3 / 40
    assert max(map(abs, steps)) <= 3 / 40
    assert all(step <= 1e-12 for step in steps)
    assert lost[-1].ambient_degC == pytest.approx(20.0, abs=1e-6)


def test_handing_back_makes_no_jump_either(tracker):
    feed(tracker, [REST] * 200)
    before = feed(tracker, [(None, 25.0)] * 1000, start=200)[-1]
    back = feed(tracker, [REST] * 1000, start=1200)
    # the main one was away for longer than a gap is bridged, and is waited for until it has settled
    assert [each.status for each in back] == ["degraded"] * SETTLING + ["tracking"] * (1000 - SETTLING)
    assert [each.used for each in back[SETTLING - 1 : SETTLING + 1]] == [(None, 25.0), REST]
    said = [each.ambient_degC for each in back]
    assert said[: SETTLING + 1] == pytest.approx([before.ambient_degC] * (SETTLING + 1), abs=1e-9)
    # then 3 degC fade with a time constant of 120 / 3 s
    assert max(b - a for a, b in itertools.pairwise(said)) <= 3 / 40
    assert said[-1] == pytest.approx(23.0, abs=1e-6)


def test_a_guard_that_has_a_say_does_not_make_an_unsettled_main_estimator_heard(make_model):
    tracker = FallbackTracker(make_model(fallbacks=True, guarded=True), 1.0)
    feed(tracker, [REST] * 200 + [(None, 25.0)] * 600)
    # begun from here, the main one says 24.6 and the guard 23: more than its threshold of 1 apart
    back = feed(tracker, [(38.0, 25.0)] * (SETTLING + 1), start=800)
    assert {each.used for each in back[:SETTLING]} == {(None, 25.0)}
    assert [each.ambient_degC for each in back[:SETTLING]] == pytest.approx([20.0] * SETTLING, abs=1e-5)
    assert back[SETTLING].used == (38.0, 25.0)


def test_a_lost_input_takes_the_fallback_over_from_the_blended_estimate(make_model):
    """usb alone is heated: the main estimator says 23 + 8, less what its lag has taken in; the secondary one 23."""
    tracker, heated = FallbackTracker(make_model(fallbacks=True, guarded=True), 1.0), (38.0, 25.0)
    feed(tracker, [REST] * 200)
    guarded = feed(tracker, [heated] * 5, start=200)[-1]
    assert guarded.status == "degraded"
    assert guarded.ambient_degC == pytest.approx(23.0)
    lost = feed(tracker, [(None, 25.0)] * 3, start=205)
    assert [each.status for each in lost] == ["degraded"] * 3
    assert lost[0].ambient_degC == pytest.approx(guarded.ambient_degC, abs=1e-9)
    # the fallback's own -2 to 2 around 20 and around what was said last: no spread
    assert (lost[0].low_degC, lost[0].high_degC) == pytest.approx((18.0, 25.0))
    assert feed(tracker, [heated], start=208)[0].ambient_degC == pytest.approx(lost[-1].ambient_degC, abs=1e-9)


def test_a_fallback_that_has_not_settled_is_not_waited_with(tracker):
    feed(tracker, [(None, 25.0)] * 40)
    assert [each.status for each in feed(tracker, [REST] * 200, start=40)] == (
        ["warming_up"] * SETTLING + ["tracking"] * (200 - SETTLING)
    )


def test_an_input_that_comes_and_goes_leaves_the_voice_where_it_is(tracker):
    feed(tracker, [REST] * 200 + [(None, 25.0)] * 600)
    said = feed(tracker, ([REST] * 100 + [(None, 25.0)] * 40) * 5, start=800)
    assert {(each.status, each.used) for each in said} == {("degraded", (None, 25.0))}


def test_after_a_pause_all_starts_anew_and_bridges_nothing(make_model):
    model = make_model(fallbacks=True, guarded=True)
    for row in ((None, 25.0), REST):
        tracker = FallbackTracker(model, 1.0)
        feed(tracker, [REST] * 200 + [(38.0, 25.0)] * 5)
        assert feed(tracker, [row], start=4000) == feed(FallbackTracker(model, 1.0), [row])


@pytest.mark.parametrize("count", [1, 2, 127, 128, 129, 300])
def test_a_fallback_that_nobody_asked_has_missed_nothing(make_model, count):
    """To the bit: the same state as a tracker that took every sample at its time, before and after it is asked."""
    model = make_model(fallbacks=True)
    together = FallbackTracker(model, 1.0)
    alone = {name: Tracker(each, nearest_discrete(each, 1.0)) for name, each in model.fallbacks.items()}
    rows = [(30 + math.sin(k / 9), 25 + math.cos(k / 7)) for k in range(count)] + [(None, 25.5), (None, 26.0)]
    for k, (usb, battery) in enumerate(rows):
        time_s = k + 0.3 * math.sin(k) + (20 if k > 100 else 0)
        together.update(time_s, (usb, battery))
        alone["usb"].update(time_s, (battery,))
        alone["battery"].update(time_s, (usb,))
    assert together.snapshot().snapshots[1:] == tuple(each.snapshot() for each in alone.values())


ALL, NO_USB, NO_BATTERY, NONE = (30.0, 25.0), (None, 25.0), (30.0, None), (None, None)
NO_TICK = ()


@pytest.mark.parametrize(
    ("fallbacks", "coast_s", "then", "said"),
    [
        (False, 0.0, [NO_USB, ALL], ["faulted", "tracking"]),
        (False, 5.0, [NO_USB] * 7 + [ALL], ["coasting"] * 5 + ["faulted"] * 2 + ["tracking"]),
        (False, 5.0, [NO_USB] * 31 + [ALL], ["coasting"] * 5 + ["faulted"] * 26 + ["warming_up"]),
        (False, 60.0, [NONE] * 59 + [ALL], ["coasting"] * 59 + ["tracking"]),
        (False, 60.0, [NONE] * 61 + [ALL], ["coasting"] * 60 + ["faulted", "warming_up"]),
        (False, 600.0, [NO_TICK] * 29 + [ALL], ["tracking"]),
        (False, 600.0, [NO_TICK] * 31 + [ALL], ["warming_up"]),
        (True, 5.0, [NO_USB] * 7 + [ALL], ["degraded"] * 7 + ["tracking"]),
        (True, 5.0, [NO_BATTERY] * 40 + [ALL] * 121, ["degraded"] * (40 + 120) + ["tracking"]),
        (
            True,
            5.0,
            [NO_BATTERY] * 40 + [NONE] * 40 + [ALL],
            ["degraded"] * 40 + ["coasting"] * 5 + ["faulted"] * 35 + ["warming_up"],
        ),
        (True, 5.0, [NO_BATTERY] * 40 + [NO_USB] + [ALL], ["degraded"] * 41 + ["warming_up"]),
        (True, 5.0, [NONE] * 6 + [NO_USB], ["coasting"] * 5 + ["faulted"] + ["degraded"]),
        (True, 0.0, [NONE, NO_USB, ALL], ["faulted", "degraded", "tracking"]),
    ],
)
def test_the_status_table(make_model, fallbacks, coast_s, then, said):
    tracker = FallbackTracker(make_model(fallbacks=fallbacks), 1.0, coast_s=coast_s)
    estimates = [tracker.update(float(k), values) for k, values in enumerate([ALL] * 200 + then) if values]
    assert [each.status for each in estimates[200:]] == said
    assert all([(each.ambient_degC is None) == (each.status == "faulted") for each in estimates])
