"""Whatever cuts a journal, what was written before is there, and nothing else."""

import json
import os
import string
import tempfile
import time

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ambient_trainer.laboratory.journal import Head, Journal, JournalRecord, read_journal
from ambient_trainer.laboratory.messages import Clock, End, Failure, Identity, LoadState, Note, Sample, StepBegan
from refusals import refused

HEAD = Head("5", "ab" * 32, 1.7e9, 1.0, False)

times = st.floats(0, 1e6)
texts = st.text(max_size=20)
values = st.dictionaries(st.text(string.ascii_letters, min_size=1, max_size=5), st.none() | st.floats(-300, 300))
entries = st.one_of(
    st.builds(Sample, texts, times, times, values, st.none() | texts),
    st.builds(Failure, texts, times, texts),
    st.builds(LoadState, times, st.none() | st.lists(texts, max_size=3).map(tuple)),
    st.builds(StepBegan, times, st.integers(0, 50), times),
    st.builds(Note, times, texts),
    st.builds(Identity, texts, texts),
    st.builds(End, times, texts),
)


def written(path, added, *head):
    journal = Journal(str(path), *head)
    for entry in added:
        journal.add(entry)
    journal.close()


@settings(max_examples=30)
@given(st.lists(entries, max_size=8))
def test_what_is_added_is_read(added):
    with tempfile.TemporaryDirectory() as folder:
        path = f"{folder}/t.csv.part"
        written(path, added, HEAD)
        assert read_journal(path) == JournalRecord(HEAD, tuple(added))


def test_a_cut_anywhere_leaves_a_beginning_that_can_be_gone_on_with(tmp_path):
    added = [
        StepBegan(0.0, 0, 0.0),
        *(Sample("device", k, k + 0.1, {"a_degC": k / 3}) for k in range(6)),
        Note(7.0, "grüße"),
    ]
    whole = tmp_path / "whole"
    written(whole, added, HEAD)
    data = whole.read_bytes()
    first = data.index(b"\n") + 1
    for length in range(first, len(data) + 1, 3):
        path = tmp_path / "cut"
        path.write_bytes(data[:length])
        kept = read_journal(str(path)).entries
        assert kept == tuple(added[: len(kept)])
        assert len(kept) == data[first:length].count(b"\n")
        written(path, [Note(9.0, "resumed")])
        assert read_journal(str(path)).entries == (*kept, Note(9.0, "resumed"))
        path.unlink()


@pytest.mark.parametrize(
    ("added", "left"),
    [
        ([], StepBegan(0.0, 0, 0.0)),
        ([StepBegan(0.0, 0, 0.0), Note(30.0, "")], StepBegan(30.0, 0, 30.0)),
        ([StepBegan(0.0, 0, 0.0), StepBegan(60.0, 1, 0.0), Sample("a", 99, 100, {})], StepBegan(100.0, 1, 40.0)),
        # stopped at 100: what comes then saw to safety
        ([StepBegan(60.0, 1, 0.0), End(100.0, "stopped"), Note(130.0, "")], StepBegan(100.0, 1, 40.0)),
        # resumed at 500, 40 s into the step, and killed at 520
        (
            [StepBegan(60.0, 1, 0.0), End(100.0, "stopped"), StepBegan(500.0, 1, 40.0), Note(520.0, "")],
            StepBegan(520.0, 1, 60.0),
        ),
    ],
)
def test_where_the_program_was_left(added, left):
    assert JournalRecord(HEAD, tuple(added)).left == left


def test_a_runs_time_goes_on_in_a_suspension_and_no_stepped_calendar_moves_it_but_over_a_new_start(monkeypatch):
    head = Head.now("5", "ab", 10.0, True)
    monkeypatch.setattr(time, "time", lambda: 1060.0)
    assert 0.0 <= head.now_s() < 100.0
    assert head._replace(boot="another", began_unix_s=1000.0).now_s() == 600.0
    # suspended for two hours
    clock, head, awake_s = Clock(), Head.now("5", "ab", 1.0, False), time.clock_gettime
    monkeypatch.setattr(time, "clock_gettime", lambda which: awake_s(which) + 7200.0 * (which == time.CLOCK_BOOTTIME))
    assert clock.now_s() == pytest.approx(head.now_s(), abs=1.0) == pytest.approx(7200.0, abs=10.0)


@pytest.mark.parametrize(
    ("text", "place"),
    [
        ("", "remove it"),
        ("{}\n", "line 1"),
        ("time_s,a_degC\n", "line 1"),
        ('{"format": "ambient-journal", "version": 2}\n', "line 1"),
        ('HEAD\n["sample"]\n', "line 2"),
        ('HEAD\n["note", 1, "a"]\n["dance", 1]\n', "line 3"),
        ("HEAD\n\n", "line 2"),
        ("HEAD\n7\n", "line 2"),
    ],
)
def test_what_is_no_journal_is_refused(text, place, write):
    head = json.dumps({"format": "ambient-journal", "version": 1, **HEAD._asdict()})
    path = write("t.part", text.replace("HEAD", head))
    assert place in str(refused(read_journal, path))


def test_nothing_is_acknowledged_before_the_disk_has_it(tmp_path, monkeypatch):
    calls = []
    write, fsync = os.write, os.fsync
    journal = Journal(str(tmp_path / "t.part"), HEAD)
    monkeypatch.setattr(os, "write", lambda file, data: calls.append("write") or write(file, data))
    monkeypatch.setattr(os, "fsync", lambda file: calls.append(f"sync, {journal.samples_on_disk}") or fsync(file))
    journal.add(Sample("device", 1.0, 1.0, {}))
    journal.flush()
    assert calls == ["write", "sync, 0"]
    assert journal.samples_on_disk == 1
    journal.close()
