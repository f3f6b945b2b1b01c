"""A campaign file is refused whole, before anything moves, with every fault and its place."""

import pytest
import yaml

from ambient_model.faults import Refused
from ambient_trainer.laboratory.campaign import load_campaign
from ambient_trainer.laboratory.trace_rows import signals_while
from ambient_trainer.simulator.device_file import load_device
from ambient_trainer.simulator.scenario import load_scenario, scenario_names, scenario_path

STEP = {"duration_min": 5, "chamber_degC": 20}
NEVER = {"chamber_degC": 20, "settle": {"within_K": 1, "for_min": 50, "at_most_min": 5}}
INSTRUMENTS = "laboratory.instruments"

# further keys, changes to the laboratory, and what the one fault names: its place first
CASES = {
    "unknown key": ({"period": 1}, {}, ["period", "unknown key", "period_s"]),
    "unknown key deep": ({}, {"device.zoned": {}}, ["laboratory.device.zoned", "unknown key"]),
    "unknown key of a kind": (
        {},
        {"instruments.chamber.baud": 9600},
        [f"{INSTRUMENTS}.chamber.baud", "unknown key", "pause_s"],
    ),
    "unknown kind": (
        {},
        {"instruments.chamber.kind": "oven"},
        [f"{INSTRUMENTS}.chamber.kind", "'oven'", "voetsch-vt4004"],
    ),
    "kind of another role": (
        {},
        {"instruments.chamber.kind": "agilent-34970a"},
        [f"{INSTRUMENTS}.chamber.kind", "'agilent-34970a'"],
    ),
    "no version": ({"version": None}, {}, ["version", "missing"]),
    "negative time": ({"steps": [{**STEP, "duration_min": -5}]}, {}, ["steps[0].duration_min", "-5", "greater than 0"]),
    "no end": ({"steps": [{"chamber_degC": 20}]}, {}, ["steps[0]", "'duration_min'", "'settle'"]),
    "no steps": ({"steps": []}, {}, ["steps", "at least 1"]),
    "too hot": (
        {"steps": [STEP, {**STEP, "chamber_degC": 80}]},
        {},
        ["steps[1].chamber_degC", "80 degC", "-20 to 60 degC"],
    ),
    "too cold before": ({"before": [{**STEP, "chamber_degC": -30}]}, {}, ["before[0].chamber_degC", "-30 degC"]),
    "unsafe safety": ({}, {"safety.set_point_degC": 70}, ["laboratory.safety.set_point_degC", "70 degC"]),
    "two on one port": (
        {},
        {"instruments.multiplexer.port": "/dev/ttyUSB0"},
        [f"{INSTRUMENTS}.multiplexer.port", "/dev/ttyUSB0", "chamber"],
    ),
    "two names of one port": (
        {},
        {"instruments.multiplexer.port": "/dev/../dev/ttyUSB0"},
        [f"{INSTRUMENTS}.multiplexer.port", "/dev/../dev/ttyUSB0", "chamber"],
    ),
    "unknown action": ({"steps": [{**STEP, "load": ["cpu_75"]}]}, {}, ["steps[0].load[0]", "'cpu_75'", "cpu_50"]),
    "unknown probe": (
        {},
        {"ambient.probes": ["air1", "air9"]},
        ["laboratory.ambient.probes[1]", "'air9'", "air1, air2, air3, air4"],
    ),
    "probe twice": ({}, {"ambient.probes": ["air1", "air1"]}, ["laboratory.ambient", "'air1'"]),
    "too many asked for": ({}, {"ambient.at_least": 5}, ["laboratory.ambient", "'at_least'", "5 of 4"]),
    "channel twice": (
        {},
        {"instruments.multiplexer.probes.air2": 101},
        [f"{INSTRUMENTS}.multiplexer.probes", "101", "air1 and air2"],
    ),
    "no channel": ({}, {"instruments.multiplexer.probes.air2": 100}, [f"{INSTRUMENTS}.multiplexer.probes.air2", "100"]),
    "column twice": (
        {},
        {"device.zones.usb": "battery_degC"},
        ["laboratory.device.zones.usb", "'battery_degC'", "laboratory.device.zones.battery"],
    ),
    "the reference again": ({}, {"device.zones.usb": "ambient_degC"}, ["laboratory.device.zones.usb", "reference"]),
    "wrong unit": ({}, {"device.zones.usb": "usb_K"}, ["laboratory.device.zones.usb", "in K", "usb_degC"]),
    "wrong unit of the gauge": (
        {},
        {"device.power_supply.columns": {"current_now": "battery_mA"}},
        ["laboratory.device.power_supply.columns", "in mA", "battery_A"],
    ),
    "no unit": ({}, {"device.zones.usb": "usb"}, ["laboratory.device.zones.usb", "'usb' names no unit"]),
    "signal of no column": (
        {},
        {"actions.cpu_50.signals": {"load_frac": 1}},
        ["laboratory.actions.cpu_50.signals.load_frac", "no such signal"],
    ),
    "limit of no column": (
        {},
        {"safety.device_high_degC": {"skin_degC": 45}},
        ["laboratory.safety.device_high_degC.skin_degC", "no such temperature"],
    ),
    "limit of a current": (
        {},
        {"safety.device_high_degC": {"battery_current_A": 45}},
        ["laboratory.safety.device_high_degC.battery_current_A", "no such temperature"],
    ),
    "connection to nowhere": ({}, {"device.connect": "telnet phone"}, ["laboratory.device.connect", "'telnet phone'"]),
    "shell in a host": ({}, {"device.connect": "ssh a;b"}, ["laboratory.device.connect", "'ssh a;b'"]),
    "can never settle": ({"steps": [NEVER]}, {}, ["steps[0].settle", "'for_min'", "'at_most_min'"]),
    "not a number": ({}, {"safety.ambient_lost_s": "soon"}, ["laboratory.safety.ambient_lost_s", "'soon'"]),
    "infinite": ({"period_s": float("inf")}, {}, ["period_s", "inf", "finite"]),
    "gradient of nothing": (
        {"steps": [{**STEP, "gradient_K_min": 0.01}]},
        {},
        ["steps[0].gradient_K_min", "0.01", "0.1"],
    ),
}


@pytest.mark.parametrize(("further", "changes", "parts"), CASES.values(), ids=CASES)
def test_each_fault_is_named_with_its_place(further, changes, parts, campaign_file):
    with pytest.raises(Refused) as refused:
        load_campaign(campaign_file(changes=changes, **further), ports=False)
    (fault,) = refused.value.faults
    assert fault.place == parts[0]
    assert all(part in str(fault) for part in parts)


def test_limits_that_hold_nothing(campaign_file):
    path = campaign_file(changes={"safety.chamber": {"low_degC": 60, "high_degC": -20}})
    with pytest.raises(Refused, match="60 to -20 degC"):
        load_campaign(path, ports=False)


def test_all_of_them_at_once(campaign_file):
    path = campaign_file(
        [{"duration_min": -1, "chamber_degC": 20}, {"duration_min": 1, "chamber_degC": 99, "load": ["dance"]}],
        {
            "instruments.chamber.port": "/dev/ttyUSB97",
            "instruments.multiplexer.port": "/dev/ttyUSB97",
            "instruments.multiplexer.kind": "sieve",
            "device.zoned": 1,
            "ambient.probes": ["air7"],
            "ambient.at_least": 1,
        },
        colour="red",
    )
    with pytest.raises(Refused) as refused:
        load_campaign(path)
    assert sorted(fault.place for fault in refused.value.faults) == [
        "colour",
        "laboratory.ambient.probes[0]",
        "laboratory.device.zoned",
        "laboratory.instruments.chamber.port",
        "laboratory.instruments.multiplexer.kind",
        "laboratory.instruments.multiplexer.port",
        "laboratory.instruments.multiplexer.port",
        "steps[0].duration_min",
        "steps[1].chamber_degC",
        "steps[1].load[0]",
    ]


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("", "holds no campaign"),
        ("[1, 2]", "holds no campaign"),
        ("steps: 5\nsteps: 6\n", "line 2, column 1"),
        ("format: ambient-campaign\nlaboratory: nowhere.yaml\n", "nowhere.yaml: cannot be read"),
        ("laboratory: 7\nbefore: 3\nsteps: {a: 1}\nformat: x\nversion: 2\nabout: y\n", "5 faults"),
        ("laboratory: {instruments: {chamber: 5, 6: 7}, device: {zones: [1]}, safety: 4}\n", "faults"),
    ],
)
def test_what_is_no_campaign_at_all(text, part, tmp_path):
    path = tmp_path / "night.yaml"
    path.write_text(text)
    with pytest.raises(Refused) as refused:
        load_campaign(str(path))
    assert part in str(refused.value)


def test_a_change_of_the_laboratorys_own_file_is_noticed(campaign_file, tmp_path, laboratory_data):
    path = campaign_file(laboratory="mine.yaml", steps=[STEP])
    digests = set()
    for connect in ("adb", "ssh phone"):
        laboratory_data["device"]["connect"] = connect
        (tmp_path / "mine.yaml").write_text(yaml.safe_dump(laboratory_data))
        loaded = load_campaign(path, ports=False)
        assert loaded.campaign.laboratory.device.connect == connect
        digests.add(loaded.sha256)
    assert len(digests) == 2


OFFSETS = """format: probe-offsets
version: 1
created: "2026-11-21"
reference: GMH thermometer
probes:
  {name}: {{points: [{{reading_degC: 20.0, offset_K: -0.12, standard_error_K: 0.01}}]}}
"""


def test_offsets_come_with_it_and_are_those_of_its_probes(campaign_file, tmp_path):
    path = campaign_file(changes={"ambient.offsets": "offsets.yaml"})
    (tmp_path / "offsets.yaml").write_text(OFFSETS.format(name="air1"))
    assert load_campaign(path, ports=False).offsets["air1"].at(20.0) == -0.12
    (tmp_path / "offsets.yaml").write_text(OFFSETS.format(name="oven"))
    with pytest.raises(Refused, match=r"laboratory\.ambient\.offsets: .*'oven'"):
        load_campaign(path, ports=False)


def test_offsets_that_cannot_be_read_are_one_fault_among_the_others(campaign_file):
    path = campaign_file(changes={"ambient.offsets": "nowhere.yaml", "ambient.at_least": 9})
    with pytest.raises(Refused) as refused:
        load_campaign(path, ports=False)
    assert {fault.place.strip() for fault in refused.value.faults} == {
        "laboratory.ambient",
        "laboratory.ambient.offsets",
    }


def shipped(name):
    return load_campaign(scenario_path(name), ports=False).campaign


@pytest.mark.parametrize("name", scenario_names())
def test_a_scenario_is_a_campaign_that_settles_once_before_it_is_recorded(name):
    campaign = shipped(name)
    assert campaign.program == load_scenario(name).program
    assert [step.settle is not None for step in campaign.program] == [True] + [False] * (len(campaign.program) - 1)


def test_all_share_one_laboratory_which_logs_the_thesis_s_sensors():
    laboratories = {shipped(name).laboratory.model_dump_json() for name in scenario_names()}
    assert len(laboratories) == 1
    device = shipped("5").laboratory.device
    assert tuple(device.zones.values()) == tuple(f"{zone}_degC" for zone in load_device().sensors)


@pytest.mark.parametrize("activity", load_device().activities)
def test_signals_are_what_the_simulation_logs(activity):
    laboratory, phone = shipped("5").laboratory, load_device()
    logged = signals_while(laboratory, () if activity == "idle" else (activity,))
    expected = {**phone.activities["idle"].logs, **phone.activities[activity].logs}
    assert expected == {name: logged[name] for name in expected}
    assert logged["camera_on"] == activity.startswith("camera")
    assert set(laboratory.actions) == set(phone.activities) - {"idle"} | {"display"}
