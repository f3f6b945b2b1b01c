"""The status table: what is there and for how long it was not, against what is said; and the clock's part in it."""

import pytest

from ambientd.fallback import FallbackTracker
from ambientd.schedule import ticks

ALL, NO_USB, NO_BATTERY, NONE = (30.0, 25.0), (None, 25.0), (30.0, None), (None, None)
SETTLED = [ALL] * 200


@pytest.mark.parametrize(
    ("fallbacks", "coast_s", "then", "said"),
    [
        (False, None, [ALL], ["tracking"]),
        (False, None, [NO_USB] * 29 + [ALL], ["coasting"] * 29 + ["tracking"]),
        (False, None, [NO_USB] * 31 + [ALL], ["coasting"] * 30 + ["faulted"] + ["warming_up"]),
        (False, 0.0, [NO_USB, ALL], ["faulted", "tracking"]),
        (False, 5.0, [NO_USB] * 7 + [ALL], ["coasting"] * 5 + ["faulted"] * 2 + ["tracking"]),
        (False, 5.0, [NO_USB] * 31 + [ALL], ["coasting"] * 5 + ["faulted"] * 26 + ["warming_up"]),
        (False, 60.0, [NONE] * 59 + [ALL], ["coasting"] * 59 + ["tracking"]),
        (False, 60.0, [NONE] * 61 + [ALL], ["coasting"] * 60 + ["faulted", "warming_up"]),
        (True, 5.0, [NO_USB] * 40, ["degraded"] * 40),
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
    estimates = [tracker.update(float(k), values) for k, values in enumerate(SETTLED + then)]
    assert [each.status for each in estimates[200:]] == said
    assert all([(each.ambient_degC is None) == (each.status == "faulted") for each in estimates])


def test_a_long_coast_does_not_lengthen_a_gap_without_any_tick(make_model):
    for gap_s, status in ((30, "tracking"), (32, "warming_up")):
        tracker = FallbackTracker(make_model(), 1.0, coast_s=600.0)
        for k, values in enumerate(SETTLED):
            tracker.update(float(k), values)
        assert tracker.update(199.0 + gap_s, ALL).status == status


@pytest.mark.parametrize(
    ("suspend_s", "status"), [(1.0, "tracking"), (20.0, "tracking"), (60.0, "warming_up"), (3600.0, "warming_up")]
)
def test_a_suspend_is_bridged_or_starts_anew_and_makes_no_burst(make_model, suspend_s, status):
    """A clock that counts suspend jumps: one tick follows, then the next on the grid."""
    tracker = FallbackTracker(make_model(), 1.0)
    now = [50.0]

    def until(due_s):
        now[0] = max(now[0], due_s)
        return True

    seen = []
    for now_s in ticks(1.0, until, lambda: now[0]):
        seen.append((now_s, tracker.update(now_s, ALL).status))
        if len(seen) == 200:
            now[0] += suspend_s
        if len(seen) == 203:
            break
    times = [time_s for time_s, _ in seen]
    assert times[200:] == [times[199] + suspend_s + 1 + k for k in range(3)]
    assert [said for _, said in seen[200:]] == [status] * 3
