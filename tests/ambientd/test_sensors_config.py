"""Which sensor carries which input: said under 'zones' or 'sensors', refused whole, and checked by what it reads."""

import pytest

from ambient_model.faults import Refused
from ambientd.config import load_settings, settings_for_model
from ambientd.sources.assign import open_sensors
from ambientd.sources.hwmon import Hwmon
from ambientd.sources.power_supply import PowerSupply
from ambientd.sources.spec import read_rules
from ambientd.sources.supervision import Rules
from ambientd.sources.zone import Zone


def saved(tmp_path, text, name="c.yaml"):
    path = tmp_path / name
    path.write_text(text)
    return str(path)


def test_every_kind_is_taken(tmp_path):
    path = saved(
        tmp_path,
        """
model: model.json
zones: {skin: quiet-therm}
zones_by_name: links
sensors:
  usb: {zone: usbc-therm-adc}
  inlet: {hwmon: nct6775, label: SYSTIN}
  battery: {power_supply: battery, property: temp}
  battery_current: {power_supply: bms, property: current_now, sign: -1}
  battery_voltage: {power_supply: bms, property: voltage_now}
supervision: {stuck_after_s: 3600, stuck_within_K: 0.1, jump_K_per_s: 0.5}
""",
    )
    taken = load_settings(path)
    assert taken.zones == {"skin": "quiet-therm"}
    assert taken.zones_by_name == str(tmp_path / "links")
    assert taken.sensors == {
        "usb": Zone("usbc-therm-adc"),
        "inlet": Hwmon("nct6775", "SYSTIN"),
        "battery": PowerSupply("battery", "temp"),
        "battery_current": PowerSupply("bms", "current_now", -1),
        "battery_voltage": PowerSupply("bms", "voltage_now", 1),
    }
    assert taken.supervision == Rules(3600.0, 0.1, 0.5)


def test_by_default_nothing_is_stuck_and_nothing_jumps():
    taken = settings_for_model("m.json")
    assert (taken.supervision, taken.sensors) == (Rules(None, 0.0, None), {})
    assert taken.zones_by_name == "/dev/thermal/tz-by-name"


def test_every_fault_is_named_at_once(tmp_path):
    path = saved(
        tmp_path,
        """
model: model.json
zones: {usb: a}
sensors:
  usb: {zone: b}
  a: [zone]
  b: {zone: x, hwmon: y}
  c: {zone: 7, offset: 1}
  d: {hwmon: chip}
  e: {power_supply: ../x, property: capacity, sign: 2}
  f: {power_supply: battery, property: temp, sign: -1}
  g: {zone: "a\\nb"}
  h: {power_supply: battery, property: current_now, sign: true}
supervision: {stuck_after_s: 59, stuck_within_K: 2, jump_K_per_s: .inf, spikes: 3}
""",
    )
    with pytest.raises(Refused) as refused:
        load_settings(path)
    assert [fault.place for fault in refused.value.faults] == [
        *("sensors.usb", "sensors.a", "sensors.b", "sensors.c.offset", "sensors.c.zone", "sensors.d.label"),
        *("sensors.e.power_supply", "sensors.e.property", "sensors.e.sign", "sensors.f.sign", "sensors.g.zone"),
        *("sensors.h.sign", "supervision.stuck_after_s", "supervision.stuck_within_K", "supervision.jump_K_per_s"),
        "supervision.spikes",
    ]
    forms = (
        "{hwmon: CHIP, label: LABEL}",
        "{iio: DEVICE, channel: CHANNEL}",
        "{power_supply: NAME, property: PROPERTY}",
        "{zone: TYPE}",
    )
    assert all(form in refused.value.faults[1].hint for form in forms)


def test_a_width_without_a_time_says_nothing():
    faults = []
    read_rules("supervision", {"stuck_within_K": 0.1}, lambda *fault: faults.append(fault))
    assert faults == [
        ("supervision.stuck_within_K", "has no effect alone", "give stuck_after_s, too, or remove it"),
    ]


def test_the_rules_of_a_configuration_are_kept(phone, make_model):
    taken = settings_for_model("m")._replace(sysfs_root=str(phone.root), supervision=Rules(jump_K_per_s=5.0))
    notes = []
    sensors = open_sensors(taken, make_model(), notes.append, lambda after_s: None)
    sensors.read(0.0)
    (phone.root / "class/thermal/thermal_zone3/temp").write_text("50000\n")
    assert sensors.read(1.0) == [30.0, None]
    sensors.close()
    assert notes == ["sensor battery: set aside (jumped from 25 to 50 degC)"]
