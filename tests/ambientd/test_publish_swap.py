"""A file is swapped in whole, with its owner and mode, or not at all; nothing unfinished stays, whatever interrupts."""

import os
import stat
import subprocess
import sys
from unittest.mock import Mock

import pytest

from ambientd.publish import swap
from ambientd.publish.access import Access
from ambientd.publish.swap import swap_in, sweep


class Alarm(BaseException):
    """As what ends a daemon that is overdue."""


@pytest.fixture
def target(tmp_path):
    return str(tmp_path / "temp")


@pytest.mark.parametrize(
    ("write", "error"),
    [
        (lambda descriptor, content, write=os.write: write(descriptor, content[:1]), OSError),
        (Mock(side_effect=Alarm), Alarm),
    ],
    ids=["a full disk", "an alarm"],
)
def test_a_write_that_is_cut_short_leaves_the_old(target, tmp_path, monkeypatch, write, error):
    swap_in(target, b"1\n", Access())
    monkeypatch.setattr(os, "write", write)
    with pytest.raises(error):
        swap_in(target, b"23\n", Access())
    assert os.listdir(tmp_path) == ["temp"]
    assert (tmp_path / "temp").read_text() == "1\n"


def test_the_mode_is_there_before_the_name_and_the_umask_does_not_count(target, monkeypatch):
    seen = []
    rename = os.rename
    monkeypatch.setattr(os, "rename", lambda old, new: (seen.append(os.stat(old).st_mode), rename(old, new)))
    before = os.umask(0o077)
    try:
        for mode in (0o644, 0o660, 0o400):
            swap_in(target, b"1\n", Access(mode))
            assert stat.S_IMODE(os.stat(target).st_mode) == stat.S_IMODE(seen[-1]) == mode
        swap_in(target, b"1\n", Access())
        assert stat.S_IMODE(os.stat(target).st_mode) == 0o600  # not configured: 0644 less the umask
    finally:
        os.umask(before)


def test_no_one_else_may_open_it_before_it_is_theirs(target, monkeypatch):
    seen = []
    monkeypatch.setattr(swap, "grant", lambda descriptor, access: seen.append(os.stat(descriptor).st_mode))
    before = os.umask(0)
    try:
        swap_in(target, b"1\n", Access(0o666))
    finally:
        os.umask(before)
    assert stat.S_IMODE(seen[0]) == 0o600


def test_what_lies_in_the_way_is_replaced_and_a_link_is_not_followed(target, tmp_path):
    (tmp_path / "precious").write_text("mine")
    os.symlink(tmp_path / "precious", f"{target}.{os.getpid()}.part")
    swap_in(target, b"1\n", Access())
    assert (tmp_path / "precious").read_text() == "mine"
    assert not os.path.islink(target)
    assert sorted(os.listdir(tmp_path)) == ["precious", "temp"]


def test_what_killed_processes_left_is_swept_and_nothing_else(target, tmp_path):
    with subprocess.Popen([sys.executable, "-c", ""]) as dead:
        dead.wait()
    stay = [f"temp.{os.getpid()}.part", "temp.1.part", "temp.x.part", "temp..part", f"other.{dead.pid}.part", "temp"]
    for name in (*stay, f"temp.{dead.pid}.part", "temp.99999999999999999999.part"):
        (tmp_path / name).write_text("")
    sweep(target)
    assert sorted(os.listdir(tmp_path)) == sorted(stay)
    sweep(str(tmp_path / "missing" / "temp"))
