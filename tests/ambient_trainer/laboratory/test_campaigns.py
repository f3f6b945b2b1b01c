"""A campaign file is refused whole, before anything moves, with every fault and its place."""

import pytest
import yaml

from ambient_model.faults import Refused
from ambient_trainer.laboratory.campaign import load_campaign
from ambient_trainer.laboratory.collect import signals_while
from ambient_trainer.simulator.device import load_device
from ambient_trainer.simulator.scenario import load_scenario, scenario_names, scenario_path
from refusals import refused, refused_places

STEP = {"duration_min": 5, "chamber_degC": 20}
NEVER = {"chamber_degC": 20, "settle": {"within_K": 1, "for_min": 50, "at_most_min": 5}}
WIRES = {"air1": {"channel": 101, "sensor": "Pt100-4w"}, "air2": 111, "air3": 103, "air4": 104}
PORT = {"kind": "voetsch-vt4004", "port": "/dev/ttyUSB0"}
# what is changed of the laboratory, to what, the place of the one fault where it is another, and what the fault names
LABORATORY = [
    ("device.zoned", {}, "", "unknown key"),
    ("device.connect", "ssh a;b", "", "'ssh a;b'"),
    ("device.zones.usb", "battery_degC", "", "'battery_degC'; laboratory.device.zones.battery"),
    ("device.zones.usb", "ambient_degC", "", "reference"),
    ("device.zones.usb", "usb_K", "", "in K; usb_degC"),
    ("device.power_supply.columns", {"current_now": "battery_mA"}, "", "in mA; battery_A"),
    ("instruments.chamber.baud", 9600, "", "unknown key; pause_s"),
    ("instruments.chamber.kind", "oven", "", "'oven'; voetsch-vt4004"),
    ("instruments.chamber.kind", "agilent-34970a", "", "'agilent-34970a'"),
    ("instruments.multiplexer.port", "/dev/../dev/ttyUSB0", "", "/dev/../dev/ttyUSB0; chamber"),
    ("instruments.multiplexer.probes.air2", 100, "", "100"),
    ("instruments.multiplexer.probes.air2", 101, "instruments.multiplexer.probes", "101; air1 and air2"),
    ("ambient.probes", ["air1", "air9"], "ambient.probes[1]", "'air9'; air1, air2, air3, air4"),
    ("ambient.probes", ["air1", "air1"], "ambient", "'air1'"),
    ("ambient.at_least", 5, "ambient", "'at_least'; 5 of 4"),
    ("actions.cpu_50.signals", {"load_frac": 1}, "actions.cpu_50.signals.load_frac", "'load_frac'; charging_on"),
    ("safety.set_point_degC", 70, "", "70 degC"),
    ("safety.unconfirmed", "hope", "", "'hope'; 'go-on', 'wait' or 'end'"),
    ("instruments.chamber", {**PORT, "values": 5, "other_values": [1, 2]}, "", "2 of other_values; the 5 values"),
    ("safety.device_high_degC", {"skin_degC": 45}, "safety.device_high_degC.skin_degC", "no temperature; soc_degC"),
    ("safety.chamber", {"low_degC": 20, "high_degC": 20}, "", "20 to 20 degC"),
    ("safety.chamber.low_degC", -50, " ", "-50 to 60 degC; -45 to 185 degC; lowest_degC"),
    ("instruments.chamber.model", "vt-1", "instruments.chamber", "'vt-1'; vc3-7060"),
    ("safety.set_point_degC", None, "", "missing; there is a chamber"),
    ("instruments.multiplexer.probes", WIRES, "instruments.multiplexer", "111; 101"),
]
# the same of the campaign itself
CAMPAIGN = [
    ({"period": 1}, "period", "unknown key; period_s"),
    ({"period_s": float("inf")}, "period_s", "inf; finite"),
    ({"steps": [{**STEP, "duration_min": -5}]}, "steps[0].duration_min", "-5; greater than 0"),
    ({"steps": [{"chamber_degC": 20}]}, "steps[0]", "'duration_min'; 'settle'"),
    ({"steps": [STEP, {**STEP, "chamber_degC": 80}]}, "steps[1].chamber_degC", "80 degC; -20 to 60 degC"),
    ({"steps": [{**STEP, "load": ["cpu_75"]}]}, "steps[0].load[0]", "'cpu_75'; cpu_50"),
    ({"steps": [{**STEP, "gradient_K_min": 0.01}]}, "steps[0].gradient_K_min", "0.01; 0.1"),
    ({"steps": [{"duration_min": 5}]}, "steps[0].chamber_degC", "missing; there is a chamber"),
    ({"steps": [NEVER]}, "steps[0].settle", "'for_min'; 'at_most_min'"),
    ({"before": [{**STEP, "chamber_degC": -30}]}, "before[0].chamber_degC", "-30 degC"),
]
CASES = [
    ({}, {place: value}, f"laboratory.{at or place}".rstrip(". "), parts) for place, value, at, parts in LABORATORY
]
CASES += [(further, {}, place, parts) for further, place, parts in CAMPAIGN]


@pytest.mark.parametrize(("further", "changes", "place", "parts"), CASES)
def test_each_fault_is_named_with_its_place(further, changes, place, parts, campaign_file):
    [fault] = refused(load_campaign, campaign_file(changes=changes, **further), ports=False).faults
    assert fault.place == place
    assert all(part in str(fault) for part in parts.split("; "))


def test_what_is_a_chambers_is_refused_without_one_and_something_measures_the_ambient(campaign_file):
    changes = {"instruments.chamber": None, "instruments.multiplexer": None}
    places = {*refused_places(load_campaign, campaign_file(changes=changes), ports=False)}
    assert places >= {"laboratory.safety.set_point_degC", "laboratory.safety.chamber", "steps[0].chamber_degC"}
    assert places >= {"laboratory.instruments", "laboratory.ambient.probes[0]"}


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
def test_what_is_no_campaign_at_all(text, part, write):
    assert part in str(refused(load_campaign, write("night.yaml", text)))


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


def test_offsets_come_with_it_are_those_of_its_probes_or_one_fault_among_the_others(campaign_file, tmp_path):
    path = campaign_file(changes={"ambient.offsets": "offsets.yaml"})
    (tmp_path / "offsets.yaml").write_text(OFFSETS.format(name="air1"))
    assert load_campaign(path, ports=False).offsets["air1"].at(20.0) == -0.12
    (tmp_path / "offsets.yaml").write_text(OFFSETS.format(name="oven"))
    with pytest.raises(Refused, match=r"laboratory\.ambient\.offsets: .*'oven'"):
        load_campaign(path, ports=False)
    path = campaign_file(changes={"ambient.offsets": "nowhere.yaml", "ambient.at_least": 9})
    places = {place.strip() for place in refused_places(load_campaign, path, ports=False)}
    assert places == {"laboratory.ambient", "laboratory.ambient.offsets"}


def shipped(name):
    return load_campaign(scenario_path(name), ports=False).campaign


@pytest.mark.parametrize("name", scenario_names())
def test_a_scenario_is_a_campaign_that_settles_once_before_it_is_recorded(name):
    campaign = shipped(name)
    assert campaign.program == load_scenario(name).program
    assert [step.settle is not None for step in campaign.program] == [True] + [False] * (len(campaign.program) - 1)


@pytest.mark.parametrize("activity", load_device().activities)
def test_signals_are_what_the_simulation_logs(activity):
    laboratory, phone = shipped("5").laboratory, load_device()
    logged = signals_while(laboratory, () if activity == "idle" else (activity,))
    expected = {**phone.activities["idle"].logs, **phone.activities[activity].logs}
    assert expected == {name: logged[name] for name in expected}
    assert logged["camera_on"] == activity.startswith("camera")
    assert set(laboratory.actions) == set(phone.activities) - {"idle"} | {"display"}
