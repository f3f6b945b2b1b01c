"""Time that passes unseen: suspends, and a wall clock that someone sets."""

import pytest


@pytest.mark.parametrize("for_s", [60.0, 3600.0])
def test_a_long_suspend_starts_again_from_equilibrium(tracking, zones, for_s):
    """Nothing of before is left, nothing is caught up, and the first value is there with the first tick."""
    due_s = tracking.outputs.status()["time_s"]
    with tracking.suspended(for_s):
        for kind in ("usb-therm", "battery", "cpu-0-0"):
            zones.say(kind, 5000)
    report = tracking.settled()
    assert (report["status"], report["time_s"], report["age_s"]) == ("warming_up", due_s + for_s, 0.0)
    assert report["ambient_degC"] == pytest.approx(3.0)
    after = tracking.steps(40)
    assert [each["time_s"] for each in after] == [due_s + for_s + k for k in range(1, 41)]
    assert after[-1]["status"] == "tracking"
    assert tracking.end() == []


def test_ticks_that_were_missed_are_skipped(start):
    """One tick for all of an hour, and the grid is the old one."""
    daemon = start()
    daemon.steps(5)
    with daemon.suspended(3600.25):
        pass
    times_s = [daemon.settled()["time_s"], *(each["time_s"] for each in daemon.steps(8, 0.25))]
    assert [each - 1005.0 for each in times_s] == [3600.25] * 3 + [3601.0] * 4 + [3602.0] * 2


@pytest.mark.parametrize("by_s", [86400.0, -86400.0], ids=["back", "forward"])
def test_a_wall_clock_that_is_set_by_a_day_is_not_looked_at(tracking, by_s):
    before = tracking.step()
    tracking.clock.set_wall_back_s(by_s)
    after = tracking.steps(60)
    assert [each["time_s"] for each in after] == [before["time_s"] + k for k in range(1, 61)]
    assert {each["status"] for each in after} == {"tracking"}
    assert tracking.end() == []


@pytest.mark.parametrize("back_s", [3600.0, 0.5])
def test_a_clock_that_goes_back_is_counted_and_the_ticks_go_on(tracking, back_s):
    """As after a virtual machine was set back. The old value does not stay."""
    before = tracking.settled()
    report = tracking.step(-back_s)
    assert (report["time_s"], report["clock_steps_back"]) == (before["time_s"] - back_s, 1)
    assert report["status"] == ("warming_up" if back_s > 1 else "tracking")
    after = tracking.steps(40)
    assert [each["time_s"] for each in after] == [report["time_s"] + k for k in range(1, 41)]
    assert (after[-1]["status"], after[-1]["missed_ticks"]) == ("tracking", 0)
    assert [f"by {back_s:.3g} s" in line for line in tracking.end()] == [True]
