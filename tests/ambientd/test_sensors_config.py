"""Which sensor carries which input: said under 'zones' or 'sensors', refused whole, and checked by what it reads."""

import json

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ambient_model.codec import encode
from ambient_model.faults import Refused
from ambient_model.model import Input
from ambientd.config import load_settings, settings_for_model
from ambientd.sources.assign import open_sensors
from ambientd.sources.hwmon import Hwmon
from ambientd.sources.power_supply import PowerSupply
from ambientd.sources.spec import read_location, read_rules
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
    forms = "{hwmon: CHIP, label: LABEL} or {power_supply: NAME, property: PROPERTY} or {zone: TYPE}"
    assert str(refused.value).splitlines() == [
        f"{path}: 16 faults",
        "  sensors.usb: stands under 'zones', too; name it once",
        f"  sensors.a: is ['zone']; one of {forms} is wanted",
        f"  sensors.b: is {{'zone': 'x', 'hwmon': 'y'}}; one of {forms} is wanted",
        "  sensors.c.offset: unknown key; known are zone",
        "  sensors.c.zone: is 7; a text is wanted",
        "  sensors.d.label: missing; a text is wanted",
        "  sensors.e.power_supply: is '../x'; the name of a folder in class/power_supply is wanted",
        "  sensors.e.property: is 'capacity'; one of temp, current_now, voltage_now is wanted",
        "  sensors.e.sign: is 2; 1 or -1 is wanted",
        "  sensors.f.sign: has no effect on 'temp'; only 'current_now' takes it: remove it",
        "  sensors.g.zone: is 'a\\nb'; a text is wanted",
        "  sensors.h.sign: is True; 1 or -1 is wanted",
        "  supervision.stuck_after_s: is 59; a number between 60 and 1e+06 is wanted",
        "  supervision.stuck_within_K: is 2; a number between 0 and 1 is wanted",
        "  supervision.jump_K_per_s: is inf; a number between 0.1 and 1e+06 is wanted",
        "  supervision.spikes: unknown key; known are stuck_after_s, stuck_within_K, jump_K_per_s",
    ]


@pytest.mark.parametrize("value", ["usb", ["usb"], 3, None])
def test_what_is_no_mapping_is_refused(tmp_path, value):
    path = saved(tmp_path, json.dumps({"model": "m", "sensors": value, "supervision": value}), "c.json")
    with pytest.raises(Refused) as refused:
        load_settings(path)
    assert [str(each) for each in refused.value.faults] == [
        f"sensors: is {value!r}; a mapping from input name to where it is read is wanted",
        f"supervision: is {value!r}; a mapping with stuck_after_s, stuck_within_K, jump_K_per_s is wanted",
    ]


values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(
            st.sampled_from(["zone", "hwmon", "label", "power_supply", "property", "sign", "stuck_after_s", 3, "x"])
            | st.text(max_size=3),
            st.sampled_from(["temp", "current_now", "battery", 1, -1, "a/b", ""]) | inner,
            max_size=4,
        )
    ),
    max_leaves=12,
)


nearly = st.fixed_dictionaries(
    {"power_supply": st.sampled_from(["battery", ""]), "property": st.sampled_from(["temp", "current_now", "x"])},
    optional={"sign": st.sampled_from([1, -1, 2]), "x": st.none()},
) | st.fixed_dictionaries({"hwmon": st.text(max_size=3)}, optional={"label": st.text(max_size=3), "x": st.none()})


@settings(derandomize=True, deadline=None, max_examples=300)
@given(values | nearly)
def test_whatever_stands_there_is_taken_whole_or_refused_with_a_reason(value):
    faults = []
    location = read_location("sensors.x", value, lambda *fault: faults.append(fault))
    assert (location is None) == bool(faults)
    told = []
    read_rules("supervision", value, lambda *fault: told.append(fault))
    assert told or set(value) <= {"stuck_after_s", "stuck_within_K", "jump_K_per_s"}


def test_a_width_without_a_time_says_nothing():
    faults = []
    read_rules("supervision", {"stuck_within_K": 0.1}, lambda *fault: faults.append(fault))
    assert faults == [
        ("supervision.stuck_within_K", "has no effect alone", "give stuck_after_s, too, or remove it"),
    ]


POWERED = (
    Input("inlet", "degC", "inlet", -20.0, 90.0),
    Input("battery_current", "A", "battery_current", -5.0, 5.0),
)


@pytest.fixture
def powered(make_model, make_hwmon, make_supply, tmp_path):
    """A model of a temperature and a current, its device, and a configuration with a sensors mapping."""
    (tmp_path / "powered.json").write_text(encode(make_model(POWERED)))
    make_hwmon(1, "board", (1, "inlet", "21500\n"))
    root = make_supply("bms", current_now="-750000\n", voltage_now="4100000\n")

    def config(sensors):
        text = json.dumps({"model": "powered.json", "sysfs_root": str(root), "sensors": sensors})
        return saved(tmp_path, text, "powered-c.json")

    return config


WHOLE = {
    "inlet": {"hwmon": "board", "label": "inlet"},
    "battery_current": {"power_supply": "bms", "property": "current_now", "sign": -1},
}


def test_check_names_each_sensor_with_the_value_read(ambientd, powered, sysfs):
    done = ambientd("check", "--config", powered(WHOLE))
    assert (done.returncode, done.stderr) == (0, "")
    said = done.stdout.splitlines()
    assert said[1:3] == [
        "input        inlet_degC, -20 to 90, hwmon board inlet",
        "input        battery_current_A, -5 to 5, power_supply bms current_now",
    ]
    assert said[-2:] == [
        f"sensor       inlet, {sysfs.root}/class/hwmon/hwmon1/temp1_input: 21.5 degC",
        f"sensor       battery_current, {sysfs.root}/class/power_supply/bms/current_now: 0.75 A",
    ]


def test_check_says_where_a_name_stands_for_several(ambientd, powered, make_hwmon):
    folder = make_hwmon(0, "board", (1, "inlet", "19000\n"))
    done = ambientd("check", "--config", powered(WHOLE))
    assert f"sensor       inlet, {folder}/temp1_input: 19 degC, the first of 2 by this name" in done.stdout.splitlines()


def test_check_names_every_sensor_that_gives_nothing_of_use(ambientd, powered, sysfs):
    (sysfs.root / "class/power_supply/bms/current_now").write_text("-7500000\n")
    done = ambientd("check", "--config", powered({**WHOLE, "inlet": {"hwmon": "board", "label": "outlet"}}))
    assert done.returncode == 1
    assert done.stderr.splitlines() == [
        f"ambientd: {sysfs.root}: 2 faults",
        "  sensor inlet: no hwmon chip 'board' with a temperature labelled 'outlet';"
        " temperatures here are {hwmon: board, label: inlet}: name one of them under 'sensors'",
        f"  sensor battery_current: {sysfs.root}/class/power_supply/bms/current_now: 7.5 A is outside -5 to 5;"
        " name the right sensor, or fit the model to it",
    ]


def test_a_sensor_in_another_unit_or_for_no_input_is_refused(ambientd, powered):
    wrong = {
        "inlet": {"power_supply": "bms", "property": "voltage_now"},
        "battery_current": {"zone": "battery"},
        "skin": {"zone": "skin"},
    }
    path = powered(wrong)
    done = ambientd("check", "--config", path)
    assert done.returncode == 1
    assert done.stderr.splitlines() == [
        f"ambientd: {path}: 3 faults",
        "  sensors.skin: is no input of the model; its inputs are inlet, battery_current",
        "  sensors.inlet: power_supply bms voltage_now is in V, and the input in degC;"
        " name a sensor with the input's unit",
        "  sensors.battery_current: zone battery is in degC, and the input in A; name a sensor with the input's unit",
    ]


def test_a_current_without_a_sensor_says_what_to_name(ambientd, powered, tmp_path):
    done = ambientd("check", "--config", powered({}))
    assert done.returncode == 1
    assert done.stderr == (
        f"ambientd: {tmp_path}/powered.json: input battery_current: is in A, and thermal zones give only degC;"
        " name a power_supply for it, 'sensors.battery_current' in a configuration, or fit a model without it\n"
    )


def test_the_sensors_that_a_configuration_names_are_read(powered, make_model):
    sensors = open_sensors(load_settings(powered(WHOLE)), make_model(POWERED), print)
    assert sensors.read(0.0) == [21.5, 0.75]
    sensors.close()


def test_the_rules_of_a_configuration_are_kept(phone, make_model):
    taken = settings_for_model("m")._replace(sysfs_root=str(phone.root), supervision=Rules(jump_K_per_s=5.0))
    notes = []
    sensors = open_sensors(taken, make_model(), notes.append)
    sensors.read(0.0)
    (phone.root / "class/thermal/thermal_zone3/temp").write_text("50000\n")
    assert sensors.read(1.0) == [30.0, None]
    sensors.close()
    assert notes == ["sensor battery: set aside (jumped from 25 to 50 degC)"]


def test_the_daemon_runs_on_every_kind_and_finds_a_renumbered_one_again(
    start, until, ended, powered, make_hwmon, sysfs, tmp_path
):
    status = tmp_path / "status"

    def raw():
        report = json.loads(status.read_text()) if status.exists() else {"sensors": {}}
        return {name: each["raw"] for name, each in report["sensors"].items()}

    daemon = start("run", "--config", powered(WHOLE), "--rate", "20", "--publish", f"status:{status}")
    until(lambda: raw() == {"inlet": 21.5, "battery_current": 0.75})
    chip = sysfs.root / "class/hwmon/hwmon1"
    (chip / "temp1_input").write_text("")
    until(lambda: raw()["inlet"] is None)
    chip.rename(tmp_path / "gone")
    make_hwmon(5, "board", (2, "inlet", "22500\n"))
    until(lambda: raw() == {"inlet": 22.5, "battery_current": 0.75})
    code, _, log = ended(daemon)
    assert code == 0
    assert log.splitlines()[1:] == [
        "ambientd: sensor inlet: no value (its content is b'')",
        "ambientd: sensor inlet: is back",
    ]
