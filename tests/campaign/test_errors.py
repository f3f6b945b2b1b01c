"""A sensor that fails with an errno, or whose zone has another number: set aside, told of, found and taken back."""

import errno
import os

import pytest

from .conftest import KINDS


@pytest.mark.parametrize("error", ["EAGAIN", "ENODATA", "ENXIO", "EIO", "ETIMEDOUT", "ENODEV", "EINVAL"])
def test_one_that_fails_is_done_without_and_taken_back(tracking, zones, error):
    """First one with a fallback, then one without."""
    before = tracking.step()
    descriptors = tracking.descriptors
    zones.fail("usb-therm", error)
    failed = tracking.steps(12)
    assert {each["status"] for each in failed} == {"degraded"}
    assert abs(failed[0]["ambient_degC"] - before["ambient_degC"]) < 0.02  # it takes over without a jump
    assert {each["sensors"]["usb"]["raw"] for each in failed} == {None}
    # a driver that has no value now is read at each tick, one that is lost ever more rarely
    assert (zones.tries("usb-therm") < 9) is (error not in ("EAGAIN", "ENODATA"))
    zones.say("battery", 31000)
    assert tracking.step()["sensors"]["battery"] == {"unit": "degC", "raw": 31.0, "used": 31.0}
    zones.heal("usb-therm")
    back = tracking.steps(40)[-1]
    assert (back["status"], back["sensors"]["usb"]["used"]) == ("tracking", 30.0)
    zones.fail("cpu-0-0", error)
    assert {each["status"] for each in tracking.steps(12)} == {"coasting"}
    zones.heal("cpu-0-0")
    assert tracking.steps(40)[-1]["status"] == "tracking"
    assert tracking.descriptors == descriptors
    reason = os.strerror(getattr(errno, error))
    assert tracking.end() == [
        f"ambientd: sensor {name}: {what}" for name in ("usb", "soc") for what in (f"no value ({reason})", "is back")
    ]


def test_zones_that_swap_numbers_while_it_runs_are_found_at_once(tracking, zones):
    """Their drivers start anew: the files that it holds open are dead, and the same numbers lead to other sensors."""
    for kind, millidegC in zip(KINDS, (31000, 32000, 33000)):  # so that a mix-up would show
        zones.say(kind, millidegC)
    expected = [each["ambient_degC"] for each in tracking.steps(3)]
    descriptors = tracking.descriptors
    places = {kind: zones.find(kind).name for kind in KINDS}
    for kind in KINDS:
        zones.unplug(kind)
    for kind, place, millidegC in zip(KINDS, (places[KINDS[k]] for k in (1, 2, 0)), (31000, 32000, 33000)):
        zones.add(int(place.removeprefix("thermal_zone")), kind, millidegC)
    after = tracking.steps(40)
    assert {each["status"] for each in after} == {"tracking"}
    used = [[sensor["used"] for sensor in each["sensors"].values()] for each in after]
    assert used == [[31.0, 32.0, 33.0]] * 40
    assert abs(after[0]["ambient_degC"] - expected[-1]) < 0.1
    assert tracking.descriptors == descriptors
    assert tracking.end() == []
