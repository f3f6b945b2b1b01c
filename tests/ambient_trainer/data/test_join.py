"""Traces of several loggers on one clock, and the command."""

import numpy as np
import pytest

from ambient_trainer.data.join import Logged, joined, load_logged, on_one_epoch
from ambient_trainer.data.trace import Trace, load_trace, save_trace
from refusals import refused


def trace(name, time_s, columns, **notes):
    time_s = np.asarray(time_s, dtype=float)
    values = {key: np.broadcast_to(np.asarray(each, dtype=float), time_s.shape) for key, each in columns.items()}
    return Trace(name, time_s, values, notes)


def test_a_column_is_drawn_averaged_or_held_and_absent_in_a_gap():
    first = trace("a", np.arange(0, 100, 10), {"a_degC": 1.0})
    slow = trace("b", np.arange(0, 101, 20), {"b_degC": np.arange(0, 101, 20) / 10})
    result = joined([first, slow, trace("c", np.arange(-5, 105, 1), {"c_degC": np.arange(110) % 2})])
    np.testing.assert_allclose(result.columns["b_degC"], first.time_s / 10)
    np.testing.assert_allclose(result.columns["c_degC"], 0.5)
    first = trace("a", np.arange(0, 60, 10), {"a_degC": 1.0})
    result = joined([first, trace("b", [0, 20, 45], {"heater_on": [0, 1, 0]})])
    np.testing.assert_array_equal(result.columns["heater_on"], [0, 0, 1, 1, 1, 0])
    first = trace("a", np.arange(0, 200, 10), {"a_degC": 1.0})
    time_s = np.r_[20:60:10, 120:160:10]
    there = ~np.isnan(joined([first, trace("b", time_s, {"b_degC": 5.0})]).columns["b_degC"])
    np.testing.assert_array_equal(first.time_s[there], time_s)
    assert "b_degC: no value" in str(refused(joined, [first, trace("b", time_s + 1e6, {"b_degC": 5.0})]))


@pytest.mark.parametrize(
    ("starts", "times", "epoch_s", "comparable"),
    [
        (("2024-05-01T10:00:00", "2024-05-01 10:00:30"), (0, 0), 30.0, True),
        (("2024-05-01T10:00:00+02:00", "2024-05-01T08:00:30Z"), (0, 0), 30.0, True),
        (("2024-05-01T10:00:00", "2024-05-01T08:00:30Z"), (0, 50), 0.0, False),
        (("1700000000.0 s", "1700000090.0 s"), (0, 0), 90.0, True),
        (("1700000000 s", "2023-11-14T22:13:50Z"), (0, 0), 30.0, True),
        ((None, None), (0, 50), 0.0, True),
        ((None, None), (0, 1.7e9), -1.7e9, True),
        (("2024-05-01T10:00:00", None), (0, 50), 0.0, False),
        (("2024-05-01T10:00:00", "5/1/2024 10:00"), (0, 1e6), -1e6, False),
    ],
)
def test_the_epoch_is_by_notes_else_by_times_else_by_the_first_samples(starts, times, epoch_s, comparable):
    made = [
        trace("x", time_s + np.arange(0, 100, 10), {"x_degC": 1.0}, **({"start": start} if start else {}))
        for start, time_s in zip(starts, times)
    ]
    placed = on_one_epoch([Logged(each, 0) for each in made])
    assert ([each.epoch_s for each in placed], placed[1].comparable) == ([0.0, epoch_s], comparable)


def test_stamps_that_repeat_or_go_back_are_left_out(write):
    logged = load_logged(write("a.csv", "# start: x\ntime_s,a_degC\n0,1\n10,2\n10,3\n5,4\n20,\n"))
    found = logged.trace.time_s.tolist(), logged.dropped_rows, logged.trace.notes
    assert found == ([0, 10, 20], 2, {"start": "x"})  # by the note it is placed
    np.testing.assert_array_equal(logged.trace.columns["a_degC"], [1, 2, np.nan])


@pytest.mark.parametrize("apply", [False, True])
def test_a_shift_is_applied_only_when_asked(tmp_path, figures, apply):
    """A board's log, and a thermometer's of the same air whose clock is 40 s behind."""
    time_s = np.arange(0.0, 8000.0, 5.0)
    air = 20 + 3 * np.sin(time_s / 700) + np.sin(time_s / 263)
    at_40 = 20 + 3 * np.sin((time_s + 40) / 700) + np.sin((time_s + 40) / 263)
    board, room, out = (tmp_path / f"{name}.csv" for name in ("board", "room", "out"))
    save_trace(str(board), trace("", time_s, {"board_degC": air + 5, "ambient_degC": air}))
    save_trace(str(room), trace("", time_s, {"ambient_degC": at_40, "wall_degC": at_40}))
    found, _ = figures("join", board, room, "-o", out, *["--shift"] * apply)
    (_, other) = found["traces"]
    low, high = other["shift"]["ci95_s"]
    assert low < 40 < high < 42
    assert other["applied_s"] == (other["shift"]["shift_s"] if apply else 0)
    result = load_trace(str(out))
    assert list(result.columns) == ["board_degC", "ambient_degC", "ambient_2_degC", "wall_degC"]
    off = np.nanmax(np.abs(result.columns["wall_degC"] - result.columns["ambient_degC"]))
    assert off < 0.02 if apply else off > 0.1
