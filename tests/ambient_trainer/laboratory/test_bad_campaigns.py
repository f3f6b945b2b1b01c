"""A bad campaign file is refused whole, before anything moves, with every fault and its place in one message."""

import pytest

from ambient_model.faults import Refused
from ambient_trainer.laboratory.campaign import load_campaign

STEP = {"duration_min": 5, "chamber_degC": 20}

CASES = {
    "unknown key": ({"period": 1}, {}, "period: unknown key; remove it or correct its name; known are format, version"),
    "unknown key deep": ({}, {"device.zoned": {}}, "laboratory.device.zoned: unknown key; remove it"),
    "no version": ({"version": None}, {}, "version: missing; add it"),
    "negative time": (
        {"steps": [{"duration_min": -5, "chamber_degC": 20}]},
        {},
        "steps[0].duration_min: -5: input should be greater than 0; correct it",
    ),
    "no end": (
        {"steps": [{"chamber_degC": 20}]},
        {},
        "steps[0]: the step never ends; give it 'duration_min', 'settle'",
    ),
    "no steps": ({"steps": []}, {}, "steps: []: tuple should have at least 1 item"),
    "too hot": (
        {"steps": [STEP, {"duration_min": 5, "chamber_degC": 80}]},
        {},
        "steps[1].chamber_degC: 80 degC is outside the chamber's limits; stay within -20 to 60 degC",
    ),
    "too cold before": (
        {"before": [{"duration_min": 5, "chamber_degC": -30}]},
        {},
        "before[0].chamber_degC: -30 degC is outside the chamber's limits; stay within -20 to 60 degC",
    ),
    "unsafe safety": (
        {},
        {"safety.set_point_degC": 70},
        "laboratory.safety.set_point_degC: 70 degC is outside the chamber's limits",
    ),
    "limits turned": ({}, {"safety.chamber": {"low_degC": 60, "high_degC": -20}}, "60 to -20 degC holds nothing"),
    "two on one port": (
        {},
        {"instruments.multiplexer.port": "/dev/ttyUSB0"},
        "laboratory.instruments.multiplexer.port: /dev/ttyUSB0 is the chamber's, too; each instrument has a port of",
    ),
    "two names of one port": (
        {},
        {"instruments.multiplexer.port": "/dev/../dev/ttyUSB0"},
        "laboratory.instruments.multiplexer.port: /dev/../dev/ttyUSB0 is the chamber's, too",
    ),
    "no such port": (
        {},
        {"instruments.chamber.port": "/dev/ttyUSB97"},
        "laboratory.instruments.chamber.port: /dev/ttyUSB97 is not there; plug the adapter in, or name its port",
    ),
    "unknown action": (
        {"steps": [{**STEP, "load": ["cpu_75"]}]},
        {},
        "steps[0].load[0]: no action is called 'cpu_75'; known are camera_1080p",
    ),
    "unknown probe": (
        {},
        {"ambient.probes": ["air1", "air9"]},
        "laboratory.ambient.probes[1]: the multiplexer has no probe 'air9'; name one of air1, air2, air3, air4",
    ),
    "probe twice": ({}, {"ambient.probes": ["air1", "air1"]}, "laboratory.ambient.probes[1]: 'air1' stands twice"),
    "too many asked for": (
        {},
        {"ambient.at_least": 5},
        "laboratory.ambient.at_least: asks for 5 of 4 probes; ask for as many as there are, or fewer",
    ),
    "channel twice": (
        {},
        {"instruments.multiplexer.probes.air2": 101},
        "laboratory.instruments.multiplexer.probes.air2: channel 101 is the probe air1's, too",
    ),
    "column twice": (
        {},
        {"device.zones.usb": "battery_degC"},
        "laboratory.device.zones.usb: 'battery_degC' is laboratory.device.zones.battery, too",
    ),
    "the reference again": ({}, {"device.zones.usb": "ambient_degC"}, "'ambient_degC' is the reference, too"),
    "wrong unit": ({}, {"device.zones.usb": "usb_K"}, "laboratory.device.zones.usb: 'usb_K' is in K; it comes in degC"),
    "no unit": ({}, {"device.zones.usb": "usb"}, "laboratory.device.zones.usb: 'usb' names no unit"),
    "signal of no column": (
        {},
        {"actions.cpu_50.signals": {"load_frac": 1}},
        "laboratory.actions.cpu_50.signals.load_frac: no such signal; add it under 'signals'",
    ),
    "limit of no column": (
        {},
        {"safety.device_high_degC": {"skin_degC": 45}},
        "laboratory.safety.device_high_degC.skin_degC: the device has no such temperature",
    ),
    "limit of a current": (
        {},
        {"safety.device_high_degC": {"battery_current_A": 45}},
        "laboratory.safety.device_high_degC.battery_current_A: the device has no such temperature",
    ),
    "way nowhere": ({}, {"device.connect": "telnet phone"}, "laboratory.device.connect: 'telnet phone': string should"),
    "shell in a host": ({}, {"device.connect": "ssh a;b"}, "laboratory.device.connect: 'ssh a;b': string should match"),
    "can never settle": (
        {"steps": [{"chamber_degC": 20, "settle": {"within_K": 1, "for_min": 50, "at_most_min": 5}}]},
        {},
        "steps[0].settle: 'for_min' is longer than 'at_most_min'; it could never settle: swap them",
    ),
    "not a number": (
        {},
        {"safety.ambient_lost_s": "soon"},
        "laboratory.safety.ambient_lost_s: 'soon': input should be",
    ),
    "infinite": ({"period_s": float("inf")}, {}, "period_s: inf: input should be a finite number"),
    "gradient of nothing": (
        {"steps": [{**STEP, "gradient_K_min": 0.01}]},
        {},
        "steps[0].gradient_K_min: 0.01: input should be greater than or equal to 0.1",
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_each_is_named_with_its_place(case, campaign_file):
    further, changes, message = CASES[case]
    path = campaign_file(changes=changes, **further)
    with pytest.raises(Refused) as refused:
        load_campaign(path, ports="not there" in message)
    assert message in str(refused.value)


def test_all_of_them_at_once(campaign_file):
    path = campaign_file(
        [{"duration_min": -1, "chamber_degC": 20}, {"duration_min": 1, "chamber_degC": 99, "load": ["dance"]}],
        {
            "instruments.multiplexer.port": "/dev/ttyUSB0",
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
        "laboratory.instruments.multiplexer.port",
        "laboratory.instruments.multiplexer.port",
        "steps[0].duration_min",
        "steps[1].chamber_degC",
        "steps[1].load[0]",
    ]
    assert str(refused.value).startswith(f"{path}: 9 faults\n  ")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "holds no campaign; start from one that is shipped"),
        ("[1, 2]", "holds no campaign"),
        ("steps: 5\nsteps: 6\n", "line 2, column 1: not YAML (key 'steps' stands twice)"),
        ("format: ambient-campaign\nlaboratory: nowhere.yaml\n", "nowhere.yaml: cannot be read (No such file"),
        ("laboratory: 7\nbefore: 3\nsteps: {a: 1}\nformat: x\nversion: 2\nabout: y\n", "5 faults"),
        ("laboratory: {instruments: {chamber: 5, 6: 7}, device: {zones: [1]}, safety: 4}\n", "faults"),
    ],
)
def test_what_is_no_campaign_at_all(text, message, tmp_path):
    path = tmp_path / "night.yaml"
    path.write_text(text)
    with pytest.raises(Refused) as refused:
        load_campaign(str(path))
    assert message in str(refused.value)


def test_the_laboratory_may_stand_in_a_file_of_its_own_whose_change_is_noticed(
    campaign_file, tmp_path, laboratory_data
):
    import yaml

    path = campaign_file(laboratory="mine.yaml", steps=[STEP])
    (tmp_path / "mine.yaml").write_text(yaml.safe_dump(laboratory_data))
    first = load_campaign(path, ports=False)
    assert first.campaign.laboratory.device.connect == "adb"
    laboratory_data["device"]["connect"] = "ssh phone"
    (tmp_path / "mine.yaml").write_text(yaml.safe_dump(laboratory_data))
    second = load_campaign(path, ports=False)
    assert second.campaign.laboratory.device.connect == "ssh phone"
    assert first.sha256 != second.sha256


OFFSETS = """format: probe-offsets
version: 1
created: "2026-11-21"
reference: GMH thermometer
probes:
  {name}: {{points: [{{reading_degC: 20.0, offset_K: -0.12, standard_error_K: 0.01}}]}}
"""


def test_offsets_come_with_it(campaign_file, tmp_path):
    (tmp_path / "offsets.yaml").write_text(OFFSETS.format(name="air1"))
    loaded = load_campaign(campaign_file(changes={"ambient.offsets": "offsets.yaml"}), ports=False)
    assert loaded.offsets["air1"].at(20.0) == -0.12


def test_offsets_of_another_s_probes_are_refused(campaign_file, tmp_path):
    (tmp_path / "offsets.yaml").write_text(OFFSETS.format(name="oven"))
    with pytest.raises(
        Refused, match=r"laboratory\.ambient\.offsets: has an offset for 'oven'; the multiplexer has no"
    ):
        load_campaign(campaign_file(changes={"ambient.offsets": "offsets.yaml"}), ports=False)


def test_offsets_that_cannot_be_read_are_one_fault_among_the_others(campaign_file):
    path = campaign_file(changes={"ambient.offsets": "nowhere.yaml", "ambient.at_least": 9})
    with pytest.raises(Refused) as refused:
        load_campaign(path, ports=False)
    assert "asks for 9 of 4 probes" in str(refused.value)
    assert "laboratory.ambient.offsets : cannot be read (No such file" in str(refused.value)
