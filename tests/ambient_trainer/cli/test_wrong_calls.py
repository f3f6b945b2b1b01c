"""Wrong calls of commands, the studies' too: what is wrong is named before the work, and nothing is written."""

import os
import shlex

import pytest

from ambient_trainer.data.trace import save_trace

from ..evaluation.conftest import sensor_trace, two_sensor_model

BROKEN = {"bare.csv": "time_s,usb_degC\n0,20\n", "empty.csv": "time_s,usb_degC,ambient_degC\n"}
# the call, its status, and what the message names
CALLS = [
    ("diagnose x.csv --circuit phone --period nan", 2, "--period; nan"),
    ("diagnose t.csv --circuit phone --later nan", 2, "--later"),
    ("diagnose t.csv --circuit phone --extended t.csv", 2, "t.csv: would be overwritten"),
    ("diagnose t.csv --circuit nosuch", 1, "'nosuch'"),
    ("diagnose t.csv --circuit phone --to 60", 1, "at least 100"),
    ("diagnose t.csv --circuit phone --to 60 --baseline u.csv", 1, "u.csv: line 1: no column 'soc_power_W'"),
    ("mitigate x.json --limit nan", 2, "--limit; nan"),
    ("evaluate x.json x.csv --from 20 --to 10", 2, "--from 20; --to 10"),
    ("limit x.json --seeds 1,-2", 2, "--seeds; 1,-2"),
    ("fit bare.csv --to 9e9 --circuit free-1 -o x", 1, "out nothing; bare.csv: line 1: no column 'ambient_degC'"),
    ("fit empty.csv --circuit free-1 -o m.json", 1, "empty.csv: no samples"),
    ("fit t.csv --circuit free-1 -o m.json --zone nosuch=back", 1, "nosuch: no such input"),
    ("fit t.csv --circuit free-1 -o m.json --starts 0", 2, "--starts; 0"),
    ("evaluate m.json t.csv --run-in", 2, "--run-in; --from"),
    ("compare t.csv --circuit free-1", 2, "--split; --held-out"),
    ("compare t.csv --circuit free-1 --held-out u.csv", 2, "u.csv is a training trace too"),
    ("compare nothere.csv --circuit free-1 --circuit nosuch --split 40", 1, "'nosuch'"),
    ("fit t.csv --circuit free-1 -o t.csv", 2, "t.csv"),
    ("evaluate m.json t.csv --json m.json", 2, "m.json"),
    ("diagnose nothere.csv --circuit phone --report t.csv", 2, "t.csv: is no folder"),
    ("discover --circuit phones", 1, "'phones'"),
    ("discover --circuit model2_ss", 2, "display, soc"),
    ("discover --circuit nosuch --report t.csv", 2, "t.csv: is no folder"),
    ("evaluate nothere.json nothere.csv --report t.csv", 2, "t.csv: is no folder"),
    ("mitigate nothere.json --report t.csv", 2, "t.csv: is no folder"),
    ("reproduce --report t.csv", 2, "t.csv: is no folder"),
    ("search nothere.csv --report t.csv", 2, "t.csv: is no folder"),
    ("identifiability t.csv --circuit model2_ss --fix C_nosuch", 1, "'C_nosuch'"),
    ("identifiability t.csv --circuit model2_ss --fix C_usb=much", 2, "'C_usb=much'"),
    ("identifiability t.csv --circuit model2_ss --fix C_usb=-5", 1, "C_usb: -5 lies outside"),
    ("identifiability t.csv --circuit free-2", 1, "free-2"),
    ("import t.csv --format csv -o o.csv", 2, "--format csv needs --map MAP.yaml"),
    ("import t.csv --format xls -o o.csv", 2, "'xls' is not one of 'benchlink', 'csv'"),
    ("import t.csv --format benchlink -o t.csv", 2, "would be overwritten by what is made from it"),
    ("import none.csv --format benchlink -o o.csv", 2, "does not exist"),
    ("import t.csv --format benchlink -o u.csv", 1, "t.csv: no line starts with 'Sweep #,'"),
    ("import t.csv --format benchlink", 2, "Missing option '-o'"),
    ("join t.csv -o o.csv", 2, "two"),
    ("join t.csv u.csv -o u.csv", 2, "u.csv"),
    ("simulate 7 -o o.csv", 2, "none is called '7'; take one of 1, 2.1, 2.2, 2.3, 2.4, 2.5, 3, 4, 5, "),
    ("simulate 1 -o o.csv --seed -1", 2, "x>=0"),
    ("simulate 1 -o o.csv --period 0.01", 2, "--period; 0.01; 0.1<=x<=60"),
    ("simulate 1 -o o.csv --hide sensor_bias:usb:2W", 2, "'sensor_bias:usb:2W', size: 'W'"),
    ("simulate 1 -o o.csv --decoy moon_on", 2, "decoy 'moon_on'"),
    ("simulate 1 -o o.csv --truth nowhere/t.json", 2, "nowhere/t.json"),
    ("correct m.json t.csv -o m.json", 2, "would be overwritten by what is made from it"),
    ("correct m.json t.csv -o o.json --from 5 --to 5", 2, "--from 5 does not come before --to 5"),
    ("correct m.json t.csv -o o.json --from 5000", 1, "nothing lies from 5000 s"),
    ("search t.csv --circuits c --no-circuits", 2, "--circuits; --no-circuits"),
    ("search t.csv --json t.csv", 2, "overwritten"),
    ("search t.csv --state x --json x", 2, "twice"),
    ("search t.csv --check u.csv", 2, "u.csv is searched, too"),
    ("search t.csv --gap 1e9", 1, "0 samples are left; --gap"),
    ("search t.csv --circuits t.csv", 2, "is no folder"),
    ("search t.csv --from 5000", 1, "from 5000"),
    ("search t.csv --to 40", 1, "20 samples for up to"),
    ("calibrate -o o.yaml", 2, "TRACE.csv; --thermometer; --simulate"),
    ("calibrate -o o.yaml --thermometer /dev/a", 2, "--multiplexer PORT; --probe"),
    ("calibrate -o o.yaml --thermometer /dev/a --multiplexer /dev/a --probe a=101", 2, "/dev/a; both"),
    ("calibrate -o o.yaml --probe a", 2, "--probe; 'a'; NAME=CHANNEL"),
    ("calibrate -o o.yaml --probe a=101 --probe a=102", 2, "--probe; twice"),
    ("calibrate -o o.yaml --simulate --points 5", 2, "4 temperatures"),
    ("calibrate -o o.yaml --simulate --window 30 --period 2", 2, "16 readings; --window 58"),
    ("calibrate -o o.yaml t.csv --points 2", 2, "--points"),
    ("calibrate -o o.yaml t.csv --record other.csv", 2, "--record"),
    ("collect 6 --dry-run", 2, "'6'"),
    ("collect 1", 2, "-o TRACE.csv"),
    ("collect 1 --speed 5 -o o.csv", 2, "--simulate"),
    ("collect 1 --simulate --resume -o o.csv", 2, "o.csv.part"),
    ("collect 1 --simulate -o nowhere/o.csv", 2, "no folder"),
    ("collect 1 -o o.csv", 1, "laboratory.instruments.chamber.port: /dev/ttyUSB0"),
    ("collect no.yaml -o o.csv", 1, "no.yaml: cannot be read"),
    ("limit m.json --seeds '3;4'", 2, "'--seeds': '3;4'"),
    ("limit m.json --fitted 0", 2, "0 is not in the range"),
    ("limit m.json --json nowhere/out.json", 2, "there is no folder "),
    ("limit m.json --scenarios 9", 1, "'9'"),
    ("mitigate m.json --limit 35", 2, "--limit 35 is not above --hottest 35"),
    ("mitigate m.json --seed 0", 2, "0 is not in the range x>=1"),
    ("mitigate m.json --workload idle", 2, "'idle' is not one of 'cpu_100', 'cpu_50', 'camera_1080p', 'camera_4k'"),
    ("mitigate m.json --lose usb 5 5", 2, "--lose usb 5 5 ends before it begins"),
    ("mitigate m.json --room warm", 1, "--room: 'warm' is no temperature; write 5, or 35/5/35 for a walk"),
    ("mitigate m.json --sensor nose", 1, "--sensor: the simulated phone has no zone 'nose'; it has soc, "),
    ("mitigate m.json --lose modem 1 2", 1, "neither the model nor; reads 'modem'; lose one of usb, battery, soc"),
    ("mitigate m.json --json m.json", 2, "would be overwritten by what is made from it"),
    ("fleet . --circuit free-1 -o out --engine somewhere", 1, "somewhere"),
    ("units m.json --count 1", 2, "1 is not in the range"),
]


@pytest.mark.parametrize(("words", "status", "facts"), CALLS)
def test_a_wrong_call(tmp_path, monkeypatch, saved, trainer, words, status, facts):
    """Beside traces, some broken, and a model, which stay as they are."""
    for name, text in BROKEN.items():
        (tmp_path / name).write_text(text)
    for name in ("t.csv", "u.csv"):
        save_trace(str(tmp_path / name), sensor_trace(300, period_s=2.0))
    os.rename(saved(two_sensor_model()), tmp_path / "m.json")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("ambient_studies.mitigation.comparison.training_trace", None)
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    found, printed, said = trainer(*shlex.split(words))
    assert (found, printed) == (status, "")
    assert all(fact in " ".join(said.split()) for fact in facts.split("; "))
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before
