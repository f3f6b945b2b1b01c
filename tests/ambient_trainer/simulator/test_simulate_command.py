"""``ambient-trainer simulate``: the file it writes, and a wrong call."""

import json
import subprocess
import sys

import pytest


def test_a_fresh_process_writes_the_same_bytes_for_the_same_seed(trainer, tmp_path):
    here, there = tmp_path / "here.csv", tmp_path / "there.csv"
    wanted = ["2.5", "--seed", "4", "--period", "20", "--zones", "-o"]
    status, out, err = trainer("simulate", *wanted, here)
    assert (status, str(here) in out, "45" in out, err) == (0, True, True, "")
    call = [sys.executable, "-m", "ambient_trainer", "simulate", *wanted, str(there)]
    assert subprocess.run(call, capture_output=True, text=True, check=True).stderr == ""
    assert here.read_bytes() == there.read_bytes()
    assert trainer("simulate", *wanted, there, "--seed", 5)[0] == 0
    assert here.read_bytes() != there.read_bytes()
    notes, header = here.read_text().splitlines()[:3], here.read_text().splitlines()[3]
    assert notes == ["# simulated: yes", "# scenario: 2.5", "# seed: 4"]
    assert header.count("_degC") > 48


def test_an_effect_is_hidden_in_the_trace_and_described_elsewhere(trainer, tmp_path):
    clean, trace, truth = (tmp_path / name for name in ("clean.csv", "trace.csv", "truth.json"))
    calm = ["simulate", "2.3", "--period", "5", "-o"]
    assert trainer(*calm, clean)[0] == 0
    text = "sensor_bias:usb:2K:from=10min"
    hide = ["--hide", text, "--hide", "ambient_coupling:all:signal=fan_on", "--decoy", "wifi_on"]
    status, out, err = trainer(*calm, trace, *hide, "--truth", truth)
    assert (status, str(trace) in out, "2 hidden effects" in out, str(truth) in out, err) == (0, True, True, True, "")
    head = trace.read_text().splitlines()[:4]
    assert head[:3] == clean.read_text().splitlines()[:3]
    assert head[3] == clean.read_text().splitlines()[3] + ",fan_on,wifi_on"
    bias, coupling = json.loads(truth.read_text())["effects"]
    assert bias["hidden"].startswith("sensor_bias:usb:2.0degC:from=600.0:to=")
    assert (bias["location"], bias["onset_s"], bias["unit"], bias["worst"]) == ("usb", 600.0, "degC", "usb_degC")
    assert bias["magnitude"] == pytest.approx(2.0, abs=0.1)
    assert (coupling["signal"], coupling["location"]) == ("fan_on", None)
    assert coupling["magnitude"] < -0.1
