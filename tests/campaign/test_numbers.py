"""Zones are known by their types: their numbers may change whenever they like."""

import itertools

KINDS = ("usb-therm", "battery", "cpu-0-0")


def distinct(zones):
    """Each sensor somewhere else, so that a mix-up would show."""
    for kind, millidegC in zip(KINDS, (31000, 32000, 33000)):
        zones.say(kind, millidegC)


def used(report):
    return [each["used"] for each in report["sensors"].values()]


def test_any_order_of_zones_is_the_same_device(start, zones):
    """A new start finds them wherever this boot has put them."""
    distinct(zones)
    seen = []
    for numbers in itertools.permutations((0, 2, 17)):
        for k, folder in enumerate(list(zones.folder.iterdir())):
            folder.rename(zones.folder / f"moving{k}")
        for kind, number in zip(KINDS, numbers):
            zones.find(kind).rename(zones.folder / f"thermal_zone{number}")
        daemon = start()
        seen.append([(each["status"], each["ambient_degC"], used(each)) for each in daemon.steps(35)])
        assert daemon.end() == []
    assert all(each == seen[0] for each in seen)
    assert seen[0][-1] == ("tracking", seen[0][0][1], [31.0, 32.0, 33.0])


def test_zones_that_swap_numbers_while_it_runs_are_found_at_once(tracking, zones):
    """Their drivers start anew: the files that it holds open are dead, and the same numbers lead to other sensors."""
    distinct(zones)
    expected = [each["ambient_degC"] for each in tracking.steps(3)]
    descriptors = tracking.descriptors
    places = {kind: zones.find(kind).name for kind in KINDS}
    for kind in KINDS:
        zones.unplug(kind)
    for kind, place, millidegC in zip(KINDS, (places[KINDS[k]] for k in (1, 2, 0)), (31000, 32000, 33000)):
        zones.add(int(place.removeprefix("thermal_zone")), kind, millidegC)
    after = tracking.steps(40)
    assert {each["status"] for each in after} == {"tracking"}
    assert [used(each) for each in after] == [[31.0, 32.0, 33.0]] * 40
    assert abs(after[0]["ambient_degC"] - expected[-1]) < 0.1
    assert tracking.descriptors == descriptors
    assert tracking.end() == []


def test_a_zone_that_is_gone_for_long_comes_back_under_another_number(tracking, zones):
    number = zones.find("battery").name
    zones.unplug("battery")
    assert {each["status"] for each in tracking.steps(300)} == {"degraded"}
    zones.add(7, "battery", 30000)
    assert number != "thermal_zone7"
    assert tracking.steps(100)[-1]["status"] == "tracking"
    assert tracking.end() == [
        "ambientd: sensor battery: no value (no thermal zone of type 'battery')",
        "ambientd: sensor battery: is back",
    ]
