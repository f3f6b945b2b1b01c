"""Zones are known by their types: their numbers may change whenever they like."""

KINDS = ("usb-therm", "battery", "cpu-0-0")


def distinct(zones):
    """Each sensor somewhere else, so that a mix-up would show."""
    for kind, millidegC in zip(KINDS, (31000, 32000, 33000)):
        zones.say(kind, millidegC)


def used(report):
    return [each["used"] for each in report["sensors"].values()]


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
