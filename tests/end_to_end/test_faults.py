"""Whatever is wrong with a file or a call: one message with file, place and mend, status 1 or 2, outputs untouched."""

import json
import os
import re
import resource
import signal
import subprocess
import sys

import numpy as np
import pytest

OLD = "what was there before"
_RNG = np.random.default_rng(3)
_ROWS = np.column_stack([np.arange(60.0), 20 + _RNG.normal(size=(60, 2)).cumsum(axis=0)]).round(3).tolist()


def table(rows, header="time_s,usb_degC,ambient_degC"):
    return "\n".join([header, *(",".join(map(str, row)) for row in rows)]) + "\n"


def with_cell(line, column, text):
    rows = [list(row) for row in _ROWS]
    rows[line - 2][column] = text
    return table(rows)


GOOD = table(_ROWS)
CONSTANT = table([[row[0], 25.5, row[2]] for row in _ROWS])
HALTING = table([[row[0], *row[1:]] if index != 9 else [3, *row[1:]] for index, row in enumerate(_ROWS)])

TRACES = {
    "empty file": ("", r"trace\.csv: the file is empty; a trace starts with a header line"),
    "header only": ("time_s,usb_degC,ambient_degC\n", r"trace\.csv: no samples under the header; log something"),
    "no sensor column": (
        table([row[::2] for row in _ROWS], "time_s,ambient_degC"),
        r"trace\.csv: line 1: no '_degC' column besides the reference; log a sensor",
    ),
    "no reference": (
        table([row[:2] for row in _ROWS], "time_s,usb_degC"),
        r"trace\.csv: line 1: no column 'ambient_degC'; it has usb_degC; log it or map it on import",
    ),
    "text in a number": (with_cell(5, 1, "warm"), r"trace\.csv: line 5, column usb_degC: 'warm' is not a number; "),
    "NaN": (with_cell(6, 1, "NaN"), r"trace\.csv: line 6, column usb_degC: 'NaN' is not a finite number; leave the"),
    "infinite": (with_cell(7, 2, "-inf"), r"trace\.csv: line 7, column ambient_degC: '-inf' is not a finite number; "),
    "time backwards": (HALTING, r"trace\.csv: line 11, column time_s: 3.* does not come after 8.*; sort the rows"),
    "constant input": (CONSTANT, r"trace\.csv: column usb_degC: is 25\.5 all the time; a stuck sensor teaches nothing"),
    "too few samples": (table(_ROWS[:4]), r"trace\.csv: 4 samples for \d+ unknowns; log longer, or take a smaller"),
}


@pytest.mark.parametrize("name", TRACES)
def test_a_faulty_trace(call, tmp_path, name):
    content, message = TRACES[name]
    trace, model = tmp_path / "trace.csv", tmp_path / "model.json"
    trace.write_text(content)
    model.write_text(OLD)
    status, _, said = call("ambient-trainer", "fit", trace, "--circuit", "free-1", "-o", model)
    assert status in (1, 2)
    assert re.search(message, said, re.DOTALL), said
    assert model.read_text() == OLD
    assert sorted(os.listdir(tmp_path)) == ["model.json", "trace.csv"]


CIRCUIT = """format: ambient-circuit
version: 1
name: mine
about: one node
form: rise
nodes:
  usb: {capacitance: C, sensor: usb}
edges:
  - {between: [usb, ambient], resistance: R}
outputs:
  ambient: {states: parallel, inputs: {usb_degC: 1}}
parameters:
  C: {unit: J/K, initial: 5}
  R: {unit: K/W, initial: 2}
"""

CIRCUITS = {
    "unknown key": (CIRCUIT.replace("about:", "aboot:"), r"mine\.yaml: .*aboot: unknown key; remove it"),
    "zero capacitance": (
        CIRCUIT.replace("initial: 5", "initial: 0"),
        r"mine\.yaml: nodes\.usb\.capacitance: .* above 0",
    ),
    "negative capacitance": (
        CIRCUIT.replace("capacitance: C,", "capacitance: -3,"),
        r"mine\.yaml: .*nodes\.usb\.capac",
    ),
    "unknown parameter": (CIRCUIT.replace("resistance: R", "resistance: Q"), r"mine\.yaml: .*edges.*'Q'"),
    "not YAML": (CIRCUIT.replace("nodes:", "nodes: ["), r"mine\.yaml: line \d+, column \d+: not YAML"),
    "empty": ("", r"mine\.yaml: the file is empty"),
    "unknown version": (CIRCUIT.replace("version: 1", "version: 2"), r"mine\.yaml: version: 2: .* 1"),
    "a sensor that the trace lacks": (CIRCUIT.replace("usb", "skin"), r"trace\.csv: line 1: no column 'skin_degC'"),
}


@pytest.mark.parametrize("name", CIRCUITS)
def test_a_faulty_circuit(call, tmp_path, name):
    content, message = CIRCUITS[name]
    (tmp_path / "trace.csv").write_text(GOOD)
    (tmp_path / "mine.yaml").write_text(content)
    model = tmp_path / "model.json"
    model.write_text(OLD)
    status, _, said = call(
        "ambient-trainer", "fit", tmp_path / "trace.csv", "--circuit", tmp_path / "mine.yaml", "-o", model
    )
    assert status in (1, 2)
    assert re.search(message, said, re.DOTALL), said
    assert model.read_text() == OLD


def test_an_unknown_circuit(call, tmp_path):
    (tmp_path / "trace.csv").write_text(GOOD)
    status, _, said = call(
        "ambient-trainer", "fit", tmp_path / "trace.csv", "--circuit", "free-9", "-o", tmp_path / "m.json"
    )
    assert status in (1, 2)
    assert "no circuit is called 'free-9'; take one of linear_battery, " in said
    assert "free-1 to free-4" in said


@pytest.fixture
def good(call, tmp_path):
    """A trace and the model fitted to it."""
    trace, model = tmp_path / "trace.csv", tmp_path / "model.json"
    trace.write_text(GOOD)
    assert call("ambient-trainer", "fit", trace, "--circuit", "free-1", "-o", model)[0] == 0
    return trace, model


def _damaged(data, *path, value):
    place = data
    for key in path[:-1]:
        place = place[key]
    place[path[-1]] = value
    return json.dumps(data)


MODELS = {
    "empty": (lambda data: "", r"model\.json: the file is empty; export the model again"),
    "truncated": (
        lambda data: json.dumps(data, indent=1)[:300],
        r"model\.json: line \d+, column \d+: not JSON .*cut off",
    ),
    "unknown version": (
        lambda data: _damaged(data, "version", value=2),
        r"model\.json: version: is 2, and only 1 is known; export the model again, or update ambientd",
    ),
    "no version": (
        lambda data: json.dumps({k: v for k, v in data.items() if k != "version"}),
        r"model\.json: version: ",
    ),
    "unknown key": (lambda data: _damaged(data, "colour", value="red"), r"model\.json: colour: unknown key; known are"),
    "wrong shape": (
        lambda data: _damaged(data, "discrete", 0, "B", value=[[1.0, 2.0]]),
        r"model\.json: discrete\[0\]\.B\[0\]: has 2 numbers, not 1; ",
    ),
    "unstable": (
        lambda data: _damaged(data, "discrete", 1, "A", value=[[1.01]]),
        r"model\.json: discrete\[1\]\.A: is unstable",
    ),
    "not a number": (
        lambda data: _damaged(data, "discrete", 0, "D", value=[[float("nan")]]),
        r"model\.json: discrete\[0\]\.D\[0\]\[0\]: is nan; a finite number is wanted",
    ),
}


@pytest.mark.parametrize("name", MODELS)
def test_a_faulty_model(call, good, tmp_path, name):
    trace, model = good
    damage, message = MODELS[name]
    model.write_text(damage(json.loads(model.read_text())))
    out = tmp_path / "out.csv"
    out.write_text(OLD)
    for command in (
        ("ambientd", "replay", model, trace, "-o", out),
        ("ambientd", "check", "--model", model),
        ("ambient-trainer", "evaluate", model, trace, "--json", out),
    ):
        status, _, said = call(*command)
        assert status in (1, 2)
        assert re.search(message, said), (command[:2], said)
        assert out.read_text() == OLD


def test_a_trace_without_what_the_model_reads(call, good, tmp_path):
    _, model = good
    other, out = tmp_path / "other.csv", tmp_path / "out.csv"
    other.write_text(GOOD.replace("usb", "skin"))
    out.write_text(OLD)
    for command in (("ambientd", "replay", model, other, "-o", out), ("ambient-trainer", "evaluate", model, other)):
        status, _, said = call(*command)
        assert (status, out.read_text()) == (1, OLD)
        assert "other.csv" in said
        assert "usb_degC" in said


WRITERS = {
    "fit": lambda trace, model, out: ("ambient-trainer", "fit", trace, "--circuit", "free-1", "-o", out),
    "fit --json": lambda trace, model, out: (
        *("ambient-trainer", "fit", trace, "--circuit", "free-1", "-o", model, "--json", out),
    ),
    "evaluate --json": lambda trace, model, out: ("ambient-trainer", "evaluate", model, trace, "--json", out),
    "evaluate --report": lambda trace, model, out: ("ambient-trainer", "evaluate", model, trace, "--report", out / "r"),
    "simulate": lambda trace, model, out: ("ambient-trainer", "simulate", "1", "-o", out),
    "replay": lambda trace, model, out: ("ambientd", "replay", model, trace, "-o", out),
}


@pytest.mark.parametrize("name", WRITERS)
def test_an_output_that_cannot_be_written(call, good, tmp_path, name):
    (tmp_path / "file").write_text("no folder")
    status, _, said = call(*WRITERS[name](*good, tmp_path / "file" / "out"))
    assert status in (1, 2)
    assert str(tmp_path / "file") in said
    assert "Traceback" not in said


def test_no_output_takes_the_place_of_an_input_or_another_output(call, good, tmp_path):
    trace, model = good
    before = {path: path.read_bytes() for path in (trace, model)}
    calls = [
        (("fit", trace, "--circuit", "free-1", "-o", trace), "trace.csv: would be overwritten by what is made from it"),
        (("fit", trace, "--circuit", "free-1", "-o", model, "--json", model), "model.json: stands twice among the out"),
        (("evaluate", model, trace, "--json", model), "model.json: would be overwritten by what is made from it"),
        (
            ("compare", trace, "--circuit", "free-1", "--split", "40", "--json", trace),
            "trace.csv: would be overwritten",
        ),
    ]
    for arguments, message in calls:
        status, _, said = call("ambient-trainer", *arguments)
        assert status == 2
        assert message in said
        assert {path: path.read_bytes() for path in before} == before


def test_one_output_that_cannot_be_written_leaves_the_others_as_they_were(call, good, tmp_path):
    trace, _ = good
    old = tmp_path / "old.json"
    old.write_text(OLD)
    status, _, said = call(
        "ambient-trainer", "fit", trace, "--circuit", "free-1", "-o", old, "--json", tmp_path / "none" / "x.json"
    )
    assert (status, old.read_text()) == (2, OLD)
    assert f"x.json: there is no folder {tmp_path / 'none'}; make it first" in said


@pytest.mark.parametrize("split", ["0", "1e9"])
def test_a_split_that_leaves_nothing(call, good, split):
    status, _, said = call("ambient-trainer", "compare", good[0], "--circuit", "free-1", "--split", split)
    assert status == 1
    assert re.search(r"--split: .* s leaves nothing on one side of .*trace\.csv \(0 to 59 s\); choose a time", said), (
        said
    )


def test_the_late_commands_look_at_their_outputs_first(call, good, tmp_path):
    trace, _ = good
    nowhere = tmp_path / "none" / "x.json"
    calls = [
        (
            ("identifiability", trace, "--circuit", "linear_usb", "--json", trace),
            "would be overwritten by what is made",
        ),
        (("reproduce", "--json", nowhere), f"there is no folder {tmp_path / 'none'}; make it first"),
    ]
    for arguments, message in calls:
        status, printed, said = call("ambient-trainer", *arguments)
        assert (status, printed) == (2, "")
        assert message in said
    assert trace.read_text() == GOOD


def test_a_link_keeps_leading_where_it_led(call, good, tmp_path):
    trace, _ = good
    (tmp_path / "link.json").symlink_to(tmp_path / "real.json")
    assert call("ambient-trainer", "fit", trace, "--circuit", "free-1", "-o", tmp_path / "link.json")[0] == 0
    assert (tmp_path / "link.json").is_symlink()
    assert json.loads((tmp_path / "real.json").read_text())["name"] == "free-1"


@pytest.mark.parametrize("name", ["fit", "simulate", "replay"])
def test_a_full_disk(good, tmp_path, name):
    """A limit on the size of files stands for the disk: the write fails half-way, as on a full one."""
    out = tmp_path / "out"
    out.write_text(OLD)
    program, *arguments = map(str, WRITERS[name](*good, out))
    module = {"ambient-trainer": "ambient_trainer", "ambientd": "ambientd"}[program]

    def nearly_full():
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (1024, 1024))

    environment = {**os.environ, "PYTHONDONTWRITEBYTECODE": "1"}
    done = subprocess.run(
        [sys.executable, "-m", module, *arguments],
        capture_output=True,
        text=True,
        preexec_fn=nearly_full,
        env=environment,
    )
    assert done.returncode == 1
    assert re.search(r"out: cannot be written \(File too large\); ", done.stderr), done.stderr
    assert "Traceback" not in done.stderr
    assert out.read_text() == OLD
    assert not [each for each in os.listdir(tmp_path) if each.endswith(".part")]


MISUSE = [
    ("ambient-trainer", "fit"),
    ("ambient-trainer", "fit", "trace.csv", "--circuit", "free-1"),
    ("ambient-trainer", "fit", "trace.csv", "--circuit", "free-1", "-o", "m.json", "--starts", "0"),
    ("ambient-trainer", "simulate", "7", "-o", "x.csv"),
    ("ambient-trainer", "evaluate", "m.json", "t.csv", "--from", "9", "--to", "3"),
    ("ambient-trainer", "evaluate", "m.json", "t.csv", "--run-in"),
    ("ambient-trainer", "compare", "t.csv", "--circuit", "free-1"),
    ("ambient-trainer", "compare", "t.csv", "--circuit", "free-1", "--held-out", "t.csv"),
    ("ambient-trainer", "nonsense"),
    ("ambientd",),
    ("ambientd", "replay"),
    ("ambientd", "run"),
    ("ambientd", "nonsense"),
]


@pytest.mark.parametrize("command", MISUSE, ids=" ".join)
def test_a_wrong_call_is_status_2(call, command):
    status, _, said = call(*command)
    assert status == 2
    assert said.strip()
    assert "Traceback" not in said
