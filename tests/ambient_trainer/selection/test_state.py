"""A state file goes with its data and options, survives a torn line, and leaves what is not its own alone."""

from __future__ import annotations

import contextlib
import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ambient_model.faults import Refused
from ambient_trainer.selection.state import State

IDENTITY = {"traces": ["ab12"], "most": 6, "gap_s": None, "tolerance_degC": 0.1}


@pytest.fixture
def path(tmp_path):
    return tmp_path / "state"


def opened(path, identity=IDENTITY):
    return contextlib.closing(State(str(path), identity))


def filled(path):
    with opened(path) as state:
        state.add({"set 1,2": 0.1 + 0.2})
        state.add({"set 3,4": 1e-300, "fit": {"theta": [1 / 3], "squares": [2.0]}})
    return state.results


def kept(path):
    with opened(path) as state:
        return state.results


def test_what_was_added_is_there_again_to_the_last_digit(path):
    results = filled(path)
    with opened(path) as again:
        assert again.results == results
        again.add({"more": 1})
    assert kept(path) == {**results, "more": 1}


def test_without_a_path_nothing_is_written(tmp_path):
    state = State(None, IDENTITY)
    state.add({"set 1": 1.0})
    state.close()
    assert state.results == {"set 1": 1.0}
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("cut", [1, 5, 30])
def test_a_line_half_written_is_cut_off(path, cut):
    filled(path)
    with open(path, "rb+") as stream:
        stream.truncate(stream.seek(0, 2) - cut)
    with opened(path) as state:
        assert list(state.results) == ["set 1,2"]
        state.add({"set 5": 5.0})
    assert list(kept(path)) == ["set 1,2", "set 5"]


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        ("most", 5, "most: the state was made with 6, this search has 5; remove it to start anew, or name another"),
        ("traces", ["cd34"], "traces: the state was made with ['ab12'], this search has ['cd34']; remove it"),
    ],
)
def test_a_stale_state_is_refused_with_what_to_do(path, name, value, said):
    filled(path)
    before = path.read_text()
    with pytest.raises(Refused) as refused:
        State(str(path), {**IDENTITY, name: value})
    assert said in str(refused.value)
    assert path.read_text() == before


def test_a_later_version_is_refused(path):
    filled(path)
    text = path.read_text().replace('"version": 1', '"version": 2')
    path.write_text(text)
    with pytest.raises(Refused, match="version: the state was made with 2"):
        State(str(path), IDENTITY)


@pytest.mark.parametrize("content", ["", "my notes", "my notes\nof today\n", "[1, 2]\n", '{"a": 1}\n', "\x00\x01\n"])
def test_a_file_that_is_none_is_refused_and_left_alone(path, content):
    path.write_text(content)
    with pytest.raises(Refused, match="is not the state of a search; name another --state"):
        State(str(path), IDENTITY)
    assert path.read_text() == content


def test_bytes_that_are_no_text_are_refused(path):
    path.write_bytes(b"\xff\xfe\x00\n")
    with pytest.raises(Refused, match="is not the state of a search"):
        State(str(path), IDENTITY)


def test_damage_in_the_middle_is_refused(path):
    filled(path)
    lines = path.read_text().splitlines(keepends=True)
    path.write_text("".join([lines[0], "{oops\n", *lines[1:]]))
    with pytest.raises(Refused, match="line 2: is damaged; remove it to start anew"):
        State(str(path), IDENTITY)


def test_two_searches_cannot_share_one(path):
    with opened(path), pytest.raises(Refused, match="another search is writing it; wait for it, or name another --st"):
        State(str(path), IDENTITY)
    assert kept(path) == {}


@given(st.binary(max_size=200))
def test_whatever_follows_the_first_line_is_read_or_refused(tmp_path_factory, tail):
    path = tmp_path_factory.mktemp("state") / "state"
    header = json.dumps({"format": "ambient-search-state", "version": 1, **IDENTITY}) + "\n"
    path.write_bytes(header.encode() + tail)
    try:
        state = State(str(path), IDENTITY)
    except Refused:
        return
    with contextlib.closing(state):
        state.add({"set 1": 1.0})
    assert kept(path)["set 1"] == 1.0
