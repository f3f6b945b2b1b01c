"""``ambient-trainer simulate``: the file it writes, and a wrong call."""

from __future__ import annotations

import subprocess
import sys

import pytest

from ambient_trainer.cli.main import main


def _run(monkeypatch, *arguments):
    monkeypatch.setattr(sys, "argv", ["ambient-trainer", "simulate", *arguments])
    with pytest.raises(SystemExit) as stopped:
        main()
    return stopped.value.code


def test_a_fresh_process_writes_the_same_bytes_for_the_same_seed(monkeypatch, capsys, tmp_path):
    here, there = tmp_path / "here.csv", tmp_path / "there.csv"
    assert _run(monkeypatch, "2.1", "--seed", "4", "--period", "2", "-o", str(here)) == 0
    assert capsys.readouterr() == (f"wrote {here}: 450 simulated samples, one every 2 s\n", "")
    command = [
        sys.executable,
        "-m",
        "ambient_trainer",
        "simulate",
        "2.1",
        "--seed",
        "4",
        "--period",
        "2",
        "-o",
        str(there),
    ]
    finished = subprocess.run(command, capture_output=True, text=True, check=True)
    assert finished.stderr == ""
    assert here.read_bytes() == there.read_bytes()
    assert here.read_text().startswith("# simulated: yes\n# scenario: 2.1\n# seed: 4\ntime_s,soc_degC,")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["7"], "'7' is not one of '1', '2.1', '2.2', '2.3', '2.4', '2.5', '3', '4', '5'"),
        (["1", "--seed", "-1"], "-1 is not in the range x>=0"),
        (["1", "--period", "0"], "0.0 is not in the range 0.1<=x<=60.0"),
    ],
)
def test_a_wrong_call_is_status_2(monkeypatch, capsys, tmp_path, arguments, message):
    assert _run(monkeypatch, *arguments, "-o", str(tmp_path / "o.csv")) == 2
    assert message in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_all_zones_on_request(monkeypatch, capsys, tmp_path):
    few, many = tmp_path / "few.csv", tmp_path / "many.csv"
    assert _run(monkeypatch, "2.5", "--period", "30", "-o", str(few)) == 0
    assert _run(monkeypatch, "2.5", "--period", "30", "--zones", "-o", str(many)) == 0
    columns = [set(path.read_text().splitlines()[3].split(",")) for path in (few, many)]
    assert columns[0] < columns[1]
    assert len([name for name in columns[1] if name.endswith("_degC")]) > 48
