"""Wrong calls of the studies' commands: refused before anything is simulated, with what is wrong."""

import shlex

import pytest

from .mitigation.sample_report import constant_model

NOT_THERE = "there is no folder "
NO_ROOM = "ambient-trainer: --room: 'warm' is no temperature; write 5, or 35/5/35 for a walk"
NO_ZONE = "ambient-trainer: --sensor: the simulated phone has no zone 'nose'; it has soc, flash, battery, "
NOT_READ = "ambient-trainer: --lose: neither the model nor the governor reads 'modem'; lose one of usb, soc"
LOADS = "'idle' is not one of 'cpu_100', 'cpu_50', 'camera_1080p', 'camera_4k', 'streaming'"


@pytest.mark.parametrize(
    ("words", "status", "message"),
    [
        ("limit --seeds '3;4'", 2, "'--seeds': '3;4'"),
        ("limit --fitted 0", 2, "0 is not in the range"),
        ("limit --json nowhere/out.json", 2, NOT_THERE),
        ("limit --scenarios 9", 1, "'9'"),
        ("mitigate --limit 35", 2, "--limit 35 is not above --hottest 35"),
        ("mitigate --seed 0", 2, "0 is not in the range x>=1"),
        ("mitigate --workload idle", 2, LOADS),
        ("mitigate --lose usb 5 5", 2, "--lose usb 5 5 ends before it begins"),
        ("mitigate --room warm", 1, NO_ROOM),
        ("mitigate --sensor nose", 1, NO_ZONE),
        ("mitigate --lose modem 1 2", 1, NOT_READ),
        ("mitigate --json model.json", 2, "would be overwritten by what is made from it"),
        ("units --count 1", 2, "1 is not in the range"),
    ],
)
def test_a_wrong_call(trainer, saved, monkeypatch, tmp_path, words, status, message):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("ambient_studies.mitigation.comparison.training_trace", None)
    command, *options = shlex.split(words)
    code, out, err = trainer(command, saved(constant_model(20.0)), *options)
    assert (code, out) == (status, "")
    assert message in err


def test_a_model_of_another_device(trainer, saved):
    status, _, err = trainer("mitigate", saved(constant_model(20.0, "ch102")))
    assert (status, "reads ch102_degC" in err) == (1, True)
