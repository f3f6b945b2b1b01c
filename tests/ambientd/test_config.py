"""A configuration is taken whole, or refused with every fault in one message."""

import json

import pytest

from ambientd.config import Settings, StateSpec, load_settings, settings_for_model
from ambientd.publish.access import Access
from ambientd.publish.file import Options
from ambientd.publish.spec import Spec
from ambientd.sources.assign import open_sensors
from ambientd.sources.hwmon import Hwmon
from ambientd.sources.power_supply import PowerSupply
from ambientd.sources.supervision import Rules
from ambientd.sources.zone import Zone
from refusals import refused

from .conftest import WHOLE


def test_every_key_is_taken_the_same_from_json_and_yaml(write, tmp_path):
    text, theirs = json.dumps(WHOLE), Access(0o640, 0, 0)  # JSON is YAML, too
    for name in ("c.json", "c.yaml"):
        path = write(name, text)
        assert load_settings(path) == Settings(
            source=path,
            model=str(tmp_path / "phone.json"),
            rate_hz=10.0,
            sysfs_root="/fake",
            publish=(
                Spec("stdout"),
                Spec("file-in-place", "/run/a", access=theirs),
                Spec("socket", str(tmp_path / "s"), access=theirs),
                Spec("file-in-place", "/run/b", theirs, Options(poison_millidegC=-274000, at_exit="poison")),
                Spec("file", "/run/c", theirs, Options(offset_millidegC=7)),
            ),
            access=theirs,
            level_percent=98,
            zones={"usb": "usbc-therm-adc"},
            zones_by_name=str(tmp_path / "links"),
            sensors={
                "skin": Zone("quiet-therm"),
                "inlet": Hwmon("nct6775", "SYSTIN"),
                "battery": PowerSupply("battery", "temp"),
                "battery_current": PowerSupply("bms", "current_now", -1),
                "battery_voltage": PowerSupply("bms", "voltage_now", 1),
            },
            supervision=Rules(3600.0, 0.1, 0.5),
            coast_s=5.0,
            state=StateSpec(str(tmp_path / "state"), 100.0, theirs),
        )


def test_the_model_alone_is_enough(write):
    path = write("c.yaml", "model: /m.json\n")
    assert load_settings(path) == settings_for_model("/m.json")._replace(source=path)
    taken = settings_for_model("m.json")
    assert taken[1:7] == ("m.json", 1.0, "/sys", (Spec("stdout"),), 90, {})
    assert (taken.supervision, taken.sensors) == (Rules(None, 0.0, None), {})
    assert taken.zones_by_name == "/dev/thermal/tz-by-name"


def test_every_fault_is_named_at_once(write):
    text = """
rate_hz: 50
sysfs_root: 7
level_percent: 95
zones: [usb]
poll: 3
coast_s: 1m
state: {age: 1, max_age_s: 0}
publish:
  - mqtt:broker
  - file
  - stdout:x
  - 12
  - {kind: file, path: /run/a, mode: append, poison_millidegC: 1.5, owner: root}
  - {kind: socket, path: /run/a, mode: rename}
"""
    faults = {fault.place: str(fault) for fault in refused(load_settings, write("c.yaml", text)).faults}
    assert list(faults) == [
        *("poll", "model", "rate_hz", "sysfs_root"),
        *(f"publish[{k}]" for k in range(4)),
        *("publish[4].owner", "publish[4].mode", "publish[4].poison_millidegC", "publish[5].mode"),
        *("level_percent", "zones", "coast_s", "state.age", "state.path", "publish"),
    ]
    assert "file, file-in-place, prometheus, socket, status, stdout" in faults["publish[0]"]
    assert all(key in faults["poll"] for key in ("zones_by_name", "supervision", "coast_s", "state"))
    assert "/run/a" in faults["publish"]


@pytest.mark.parametrize(
    ("text", "name", "fact"),
    [
        ("", "c.yaml", "'model: MODEL.json'"),
        ('{"model": "a", "model": "b"}', "c.json", "'model'"),
        ("model: a\nzones: {usb: x, usb: y}\n", "c.yaml", "'usb'"),
        ("model: [a\n", "c.yaml", "line 2, column 1"),
        ("model: a", "c.json", "line 1, column 1"),
        ("model: a\x07b", "c.yaml", "special characters"),
        ("model: a\nrate_hz: true\n", "c.yaml", "rate_hz: is True"),
        ("model: a\nrate_hz: .nan\n", "c.yaml", "rate_hz: is nan"),
        ("model: a\npublish: []\n", "c.yaml", "publish: is []"),
        ("model: a\npublish: ['status:/x/../s']\nstate: {path: /s}\n", "c.yaml", "publish: /s is duplicated"),
        ("model: a\npublish: ['status:a']\n", "c.yaml", "a is what the daemon reads"),
        ("model: a\nstate: /s\n", "c.yaml", "state: is '/s'"),
        ("model: a\nstate: {path: /s, max_age_s: 0}\n", "c.yaml", "state.max_age_s: is 0"),
        ("model: a\nsupervision: {stuck_within_K: 0.1}\n", "c.yaml", "supervision.stuck_within_K: has no effect alone"),
    ],
)
def test_each_is_refused(write, text, name, fact):
    assert fact in str(refused(load_settings, write(name, text)))


def test_files_that_cannot_be_read_are_refused(tmp_path):
    path = tmp_path / "some.yaml"
    assert "cannot be read (No such file or directory)" in str(refused(load_settings, str(path)))
    path.write_bytes(b"\xff\xfe\x00model")
    assert "not text" in str(refused(load_settings, str(path)))


def test_every_fault_of_the_sensors_is_named_at_once(write):
    text = """
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
"""
    refusal = refused(load_settings, write("c.yaml", text))
    assert [fault.place for fault in refusal.faults] == [
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
    assert all(form in refusal.faults[1].hint for form in forms)


def test_the_rules_of_a_configuration_are_kept(phone, make_model):
    taken = settings_for_model("m")._replace(sysfs_root=str(phone.root), supervision=Rules(jump_K_per_s=5.0))
    notes = []
    sensors = open_sensors(taken, make_model(), notes.append, lambda after_s: None)
    sensors.read(0.0)
    (phone.root / "class/thermal/thermal_zone3/temp").write_text("50000\n")
    assert sensors.read(1.0) == [30.0, None]
    sensors.close()
    assert notes == ["sensor battery: set aside (jumped from 25 to 50 degC)"]
