"""Each kind of sensor is found by name, whatever number it has at this boot, and read in degC, A or V."""

import math
from pathlib import Path

import pytest

from ambientd.config import settings_for_model
from ambientd.sources.hwmon import Hwmon, find_hwmon
from ambientd.sources.iio import Iio, find_iio
from ambientd.sources.power_supply import PowerSupply
from ambientd.sources.zone import Zone, find_zones
from device import write_files


def on(root, **more):
    return settings_for_model("m")._replace(sysfs_root=str(root), **more)


def value_of(location, root):
    (path,) = location.find(on(root))
    return location.conversion(path)(Path(path).read_bytes())


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


def test_where_there_is_no_such_class_nothing_is_found(tmp_path):
    root = str(tmp_path)
    assert find_zones(root) == find_hwmon(root) == {}
    for location in (Hwmon("nvme", "Composite"), Iio("hts221", "in_temp"), PowerSupply("bms", "temp")):
        assert location.find(on(root)) == []
        assert "none" in location.hint(on(root))


@pytest.fixture
def by_name(phone, tmp_path):
    folder = tmp_path / "dev/thermal/tz-by-name"
    folder.mkdir(parents=True)
    return folder


def found(phone, by_name, kind):
    return Zone(kind).find(on(phone.root, zones_by_name=str(by_name)))


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


@pytest.fixture
def chips(make_hwmon, sysfs):
    """Two chips, one of them twice."""
    make_hwmon(10, "nct6775", (1, "SYSTIN", "41000\n"), (2, "CPUTIN", "52500\n"), (10, "PECI", "60000\n"))
    make_hwmon(2, "nvme", (1, "Composite", "38850\n"), (3, None, "40850\n"))
    make_hwmon(3, "nvme", (1, "Composite", "29850\n"))
    return sysfs.root


def test_chips_and_labels_are_found_in_the_order_of_their_numbers(chips):
    folder = f"{chips}/class/hwmon"
    assert find_hwmon(str(chips)) == {
        ("nvme", "Composite"): [f"{folder}/hwmon2/temp1_input", f"{folder}/hwmon3/temp1_input"],
        ("nvme", "temp3"): [f"{folder}/hwmon2/temp3_input"],
        ("nct6775", "SYSTIN"): [f"{folder}/hwmon10/temp1_input"],
        ("nct6775", "CPUTIN"): [f"{folder}/hwmon10/temp2_input"],
        ("nct6775", "PECI"): [f"{folder}/hwmon10/temp10_input"],
    }


def test_what_is_no_temperature_or_has_no_name_is_passed_over(chips):
    folder = chips / "class/hwmon/hwmon10"
    for name in ("temp2_max", "fan1_input", "in0_input", "temp_input", "tempX_input"):
        (folder / name).write_text("1\n")
    before = find_hwmon(str(chips))
    (chips / "class/hwmon/hwmon3/name").unlink()
    del before["nvme", "Composite"][1]
    assert find_hwmon(str(chips)) == before


@pytest.fixture
def devices(tmp_path):
    """The sensors of a Sense HAT, a BME280 as on Enviro+, and a light sensor, as their drivers show them."""
    files_of = {
        0: {"name": "bme280", "in_temp_input": "22910", "in_pressure_input": "100.1"},
        10: {"name": "lps25h", "in_temp_raw": "-8350", "in_temp_offset": "20400", "in_temp_scale": "2.083333"},
        2: {"name": "hts221", "in_temp_raw": "136", "in_temp_offset": "1148.461538", "in_temp_scale": "16.25"},
        3: {"name": "mlx90614", "in_temp_ambient_raw": "14700", "in_temp_offset": "-13657.5"}
        | {"in_temp_scale": "20", "in_temp_object_input": "21937.500000"},
        4: {"name": "ltr559", "in_illuminance_input": "81"},
    }
    for number, files in files_of.items():
        lines = {name: f"{content}\n" for name, content in files.items()}
        write_files(tmp_path / "bus/iio/devices" / f"iio:device{number}", lines)
    return tmp_path


@pytest.mark.parametrize(
    ("device", "channel", "degC"),
    [
        ("bme280", "in_temp", 22.91),
        ("lps25h", "in_temp", (20400 - 8350) * 2.083333e-3),
        ("hts221", "in_temp", 20.8725),
        ("mlx90614", "in_temp_ambient", 20.85),
        ("mlx90614", "in_temp_object", 21.9375),
    ],
)
def test_each_iio_driver_s_form_is_read_in_degC(devices, device, channel, degC):
    assert value_of(Iio(device, channel), devices) == pytest.approx(degC)


def test_only_temperatures_of_named_iio_devices_are_found(devices):
    (devices / "bus/iio/devices/iio:device0/name").unlink()
    assert [str(each) for each in find_iio(str(devices))] == [
        "iio hts221 in_temp",
        "iio mlx90614 in_temp_ambient",
        "iio mlx90614 in_temp_object",
        "iio lps25h in_temp",
    ]


@pytest.mark.parametrize(("attribute", "content"), [("scale", "x"), ("offset", "inf"), ("raw", "-"), ("raw", "1e3")])
def test_what_is_no_number_is_no_iio_value(devices, attribute, content):
    (devices / "bus/iio/devices/iio:device2" / f"in_temp_{attribute}").write_text(f"{content}\n")
    assert value_of(Iio("hts221", "in_temp"), devices) is None


def test_each_property_of_a_supply_in_its_unit(make_supply):
    root = make_supply("battery", temp="-53\n", current_now="-1500000\n", voltage_now="3912500\n")
    expected = {"temp": (-5.3, "degC"), "current_now": (-1.5, "A"), "voltage_now": (3.9125, "V")}
    for name, (number, unit) in expected.items():
        location = PowerSupply("battery", name)
        assert (value_of(location, root), location.unit) == (number, unit)


def test_for_a_vendor_that_counts_the_other_way_no_current_is_no_negative_zero(make_supply):
    root = make_supply("battery", current_now="0\n")
    assert math.copysign(1.0, value_of(PowerSupply("battery", "current_now", -1), root)) == 1.0
