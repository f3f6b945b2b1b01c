"""A thermal zone is found by its type, by the link that Android keeps where it can be believed."""

import pytest

from ambientd.sources.zone import Zone, ZoneTemperature, find_zones


def test_zones_are_found_by_type_in_the_order_of_their_numbers(sysfs):
    for number, kind in ((10, "usb-therm"), (2, "usb-therm"), (1, "battery")):
        sysfs.zone(number, kind, "1\n")
    (sysfs.root / "class/thermal/cooling_device0").mkdir()
    (sysfs.root / "class/thermal/thermal_zone7").mkdir()  # without a type
    (sysfs.root / "class/thermal/thermal_zone²").mkdir()
    folder = f"{sysfs.root}/class/thermal"
    assert find_zones(str(sysfs.root)) == {
        "battery": [f"{folder}/thermal_zone1"],
        "usb-therm": [f"{folder}/thermal_zone2", f"{folder}/thermal_zone10"],
    }


def test_no_thermal_class_is_no_zones(tmp_path):
    assert find_zones(str(tmp_path)) == {}


@pytest.fixture
def by_name(phone, tmp_path):
    folder = tmp_path / "dev/thermal/tz-by-name"
    folder.mkdir(parents=True)
    return folder


def found(phone, by_name, kind):
    return ZoneTemperature(Zone(kind), str(phone.root), str(by_name)).find()


def test_a_link_by_name_is_followed(phone, by_name):
    phone.zone(11, "usb-therm", "31000\n")
    (by_name / "usb-therm").symlink_to(phone.root / "class/thermal/thermal_zone11")
    assert found(phone, by_name, "usb-therm") == [f"{phone.root}/class/thermal/thermal_zone11/temp"]


def test_a_link_by_name_makes_no_look_through_all_zones(phone, by_name, monkeypatch):
    (by_name / "battery").symlink_to(phone.root / "class/thermal/thermal_zone3")
    monkeypatch.setattr("ambientd.sources.zone.find_zones", lambda root: pytest.fail("looked through"))
    assert found(phone, by_name, "battery") == [f"{phone.root}/class/thermal/thermal_zone3/temp"]


@pytest.mark.parametrize("target", ["sys/class/thermal/thermal_zone0", "sys/class/thermal/thermal_zone99", "other"])
def test_a_link_that_is_old_or_leads_elsewhere_is_not(phone, by_name, tmp_path, target):
    (tmp_path / "other").mkdir()
    (tmp_path / "other/type").write_text("battery\n")
    (by_name / "battery").symlink_to(tmp_path / target)
    assert found(phone, by_name, "battery") == [f"{phone.root}/class/thermal/thermal_zone3/temp"]


@pytest.mark.parametrize("kind", ["../../sys/class/thermal/thermal_zone3", "a\0b", ".", "ü\udcff"])
def test_a_type_that_is_no_file_name_is_only_looked_for(phone, by_name, kind):
    assert found(phone, by_name, kind) == []
