"""A replay says what the daemon would have said, and leaves the output alone where it cannot."""

import csv
import random
from pathlib import Path

import pytest

from ambientd.sources.replay import TraceSource


def rows_of(path):
    with open(path, newline="") as stream:
        return list(csv.DictReader(stream))


def test_every_row_has_its_estimate(ambientd, model_file, trace_file, tmp_path):
    """What the numbers are to be is compared by the parity tests."""
    out = tmp_path / "out.csv"
    done = ambientd("replay", model_file, trace_file, "-o", out)
    assert (done.stdout, done.stderr) == (f"{out}: 600 estimates\n", "")
    rows = rows_of(out)
    assert list(rows[0]) == ["time_s", "ambient_degC", "low_degC", "high_degC", "status"]
    assert [float(row["time_s"]) for row in rows] == [100.0 + k for k in range(600)]
    assert {row["status"] for row in rows[:100]} == {"warming_up"}
    assert {row["status"] for row in rows[-100:]} == {"tracking"}


def test_from_and_to_cut_before_the_estimate_starts(ambientd, model_file, trace_file, tmp_path):
    out, of_the_part = tmp_path / "out.csv", tmp_path / "part.csv"
    ambientd("replay", model_file, trace_file, "-o", out, "--from", 150, "--to", 250)
    header, *rows = Path(trace_file).read_text().splitlines(keepends=True)
    Path(trace_file).write_text("".join([header, *rows[50:150]]))
    ambientd("replay", model_file, trace_file, "-o", of_the_part)
    assert out.read_text() == of_the_part.read_text()


def test_a_missing_value_is_coasted_over_and_a_long_gap_is_an_empty_cell(ambientd, model_file, write_trace, tmp_path):
    rows = [(float(k), 30.0, None if 50 <= k < 90 else 25.0) for k in range(100)]
    out = tmp_path / "out.csv"
    ambientd("replay", model_file, write_trace(rows), "-o", out)
    said = rows_of(out)
    assert [row["status"] for row in said[50:90]] == ["coasting"] * 30 + ["faulted"] * 10
    assert (said[85]["ambient_degC"], said[85]["low_degC"], said[85]["high_degC"]) == ("", "", "")
    assert float(said[79]["ambient_degC"]) == pytest.approx(23.0)


REFUSALS = [
    ("time_s,usb_degC\n0,1\n", (), "'battery_degC'"),
    ("time_s,usb_degC,battery_degC\n", (), "no samples"),
    ("time_s,usb_degC,battery_degC\n0,1,2\n", ("--from", "5"), "--from"),
    ("time_s,usb_degC,battery_degC\n0,1,2\n1,x,2\n", (), "line 3, column usb_degC: 'x'"),
    ("time_s,usb_degC,battery_degC\n0,1,2\n60,1,2\n120,1,2\n", (), "60 s apart"),
]


@pytest.mark.parametrize(("text", "cut", "fact"), REFUSALS)
def test_what_cannot_be_replayed_is_refused_and_the_output_left(ambientd, model_file, tmp_path, text, cut, fact):
    (tmp_path / "t.csv").write_text(text)
    (tmp_path / "out.csv").write_text("before")
    done = ambientd("replay", model_file, tmp_path / "t.csv", "-o", tmp_path / "out.csv", *cut, status=1)
    assert done.stdout == ""
    assert done.stderr.startswith(f"ambientd: {tmp_path}/t.csv: ")
    assert fact in done.stderr
    assert (tmp_path / "out.csv").read_text() == "before"
    assert sorted(each.name for each in tmp_path.iterdir()) == ["model.json", "out.csv", "t.csv"]


def test_a_trace_is_not_overwritten_by_its_own_replay(ambientd, model_file, trace_file):
    done = ambientd("replay", model_file, trace_file, "-o", trace_file, status=1)
    assert f"{trace_file}: would be overwritten" in done.stderr
    assert len(rows_of(trace_file)) == 600


@pytest.mark.parametrize("period_s", [0.1, 0.5, 1.0, 10.0])
def test_the_period_is_learned_through_jitter_gaps_and_a_late_start(make_model, write_trace, period_s):
    rng = random.Random(3)
    times = [0.0]
    for k in range(500):
        times.append(times[-1] + period_s * (40 if k % 50 == 3 else 1) * rng.uniform(0.99, 1.01))
    with TraceSource(write_trace([(t, 30.0, 25.0) for t in times]), make_model().main.inputs) as source:
        assert source.period_s == pytest.approx(period_s, rel=2e-3)
        assert [time_s for time_s, _ in source] == times  # none of the rows that were read first is lost
