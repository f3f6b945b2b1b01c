"""One daemon a published file, whoever starts first, and no file of another user in its place."""

import os
import re
import signal

import pytest

from ambientd.publish.claims import Claims
from refusals import refused

from .conftest import text


@pytest.mark.parametrize("kind", ["file", "file-in-place", "status", "prometheus"])
def test_a_second_daemon_is_refused_until_the_first_has_ended_in_any_way(start, until, ended, on_phone, tmp_path, kind):
    out = tmp_path / "temp"
    run = on_phone(f"{kind}:{out}")
    first = start(*run)
    until(lambda: text(out))
    second = start(*run)
    assert second.wait(15) == 1
    assert re.search(rf"{out}: another daemon", second.stderr.read())
    assert text(out), "the first one's file was taken away"
    os.kill(first.pid, signal.SIGKILL)
    first.wait()
    out.unlink()
    third = start(*run)
    until(lambda: text(out))
    assert ended(third)[0] == 0
    assert not out.exists()


def test_a_claim_is_taken_once_closed_to_others_and_leaves_nothing(tmp_path):
    claims = Claims()
    for _ in range(2):
        claims.take(str(tmp_path / "a"))
    assert os.listdir(tmp_path) == ["a.lock"]
    assert (tmp_path / "a.lock").stat().st_mode & 0o777 == 0o600, "nobody else may hold it"
    claims.keep([])
    assert os.listdir(tmp_path) == []


@pytest.mark.parametrize("name", ["a", "a.lock"])
def test_another_users_file_in_a_folder_of_many_is_refused_by_name(tmp_path, monkeypatch, name):
    folder = tmp_path / "sticky"
    folder.mkdir()
    folder.chmod(0o1777)
    (folder / name).write_text("20000\n")
    monkeypatch.setattr(os, "geteuid", lambda: 4711)
    assert f"{folder}/{name}: belongs to user {os.getuid()}" in str(refused(Claims().take, str(folder / "a")))
    assert os.listdir(folder) == [name]
