"""A state file goes with its data and options, survives a kill, and leaves what is not its own alone."""

import os
import signal
import sqlite3
import threading
import time

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ambient_model.faults import Refused
from ambient_trainer.estimation.workers import uninterrupted
from ambient_trainer.selection.resumable import ResumablePool
from refusals import refused

IDENTITY = {"traces": ["ab12"], "most": 6, "gap_s": None, "tolerance_degC": 0.1}


def thirds(keys):
    """Results that have digits to lose."""
    return [{"value": each[0] / 3, "tiny": 1e-300} for each in keys]


@pytest.fixture
def path(tmp_path):
    return str(tmp_path / "state")


def computed(path, keys, identity=IDENTITY, at_once=1):
    """The results of ``keys``, and how many of them were computed."""
    with ResumablePool(1, path, identity) as pool:
        known = len(pool.known)
        return pool.results("thirds", thirds, keys, at_once), len(pool.known) - known


def test_without_a_path_nothing_is_written_and_with_one_all_is_known_again(path, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert computed(None, [(1,)])[1] == 1
    assert list(tmp_path.iterdir()) == []
    first, count = computed(path, [(1,), (2,), (1,)], at_once=2)
    again, more = computed(path, [(1,), (2,), (5,)])
    assert (count, more) == (2, 1)
    assert again == {**first, (5,): {"value": 5 / 3, "tiny": 1e-300}}


@pytest.mark.parametrize(("name", "value"), [("most", 5), ("traces", ["cd34"]), ("version", 9)])
def test_a_state_of_something_else_is_refused_with_both_values(path, name, value):
    computed(path, [(1,)])
    said = str(refused(computed, path, [(1,)], {**IDENTITY, name: value}))
    assert name in said
    assert f"this search has {value!r}" in said
    assert "--state" in said
    assert computed(path, [(1,)])[1] == 0


def foreign():
    database = sqlite3.connect(":memory:")
    database.execute("CREATE TABLE mine (x)")
    database.commit()
    return database.serialize()


@pytest.mark.parametrize("content", [b"", b"my notes\nof today\n", b'{"a": 1}\n', b"\xff\xfe\x00\n", foreign()])
def test_a_file_that_is_none_is_refused_and_left_alone(tmp_path, path, content):
    (tmp_path / "state").write_bytes(content)
    assert "is not the state of a search" in str(refused(computed, path, [(1,)]))
    assert (tmp_path / "state").read_bytes() == content


def test_two_searches_cannot_share_one(path):
    with ResumablePool(1, path, IDENTITY), pytest.raises(Refused, match="another search"):
        ResumablePool(1, path, IDENTITY)
    assert computed(path, [(1,)])[1] == 1


@settings(max_examples=40)
@given(st.data())
def test_a_damaged_file_is_read_or_refused(tmp_path_factory, data):
    path = tmp_path_factory.mktemp("state") / "state"
    computed(str(path), [(1,), (2,)])
    whole = bytearray(path.read_bytes())
    start = data.draw(st.integers(0, len(whole) - 1))
    whole[start : start + 20] = data.draw(st.binary(min_size=1, max_size=20))
    path.write_bytes(whole)
    try:
        results, _ = computed(str(path), [(7,)])
    except Refused:
        return
    assert results[(7,)]["value"] == 7 / 3


def test_ctrl_c_while_workers_start_is_not_lost_to_a_thread_that_was_there():
    begun_s = time.monotonic()
    threading.Timer(0.1, os.kill, (os.getpid(), signal.SIGINT)).start()
    with pytest.raises(KeyboardInterrupt), uninterrupted():
        time.sleep(0.3)
    assert time.monotonic() - begun_s >= 0.3
