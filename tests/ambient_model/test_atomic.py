import errno
import os
import shutil
import stat
import subprocess
import sys
from pathlib import Path

import pytest

from ambient_model.atomic import replacing
from ambient_model.faults import Refused


@pytest.fixture
def old(tmp_path: Path) -> Path:
    path = tmp_path / "model.json"
    path.write_text("old")
    return path


def assert_untouched(old: Path) -> None:
    assert old.read_text() == "old"
    assert os.listdir(old.parent) == [old.name]


def test_the_new_content_appears_with_the_end_of_the_block(old: Path) -> None:
    with replacing(str(old)) as stream:
        stream.write("new °C\r\n")
        stream.flush()
        assert old.read_text() == "old"
    assert old.read_bytes() == "new °C\r\n".encode()
    assert os.listdir(old.parent) == [old.name]


@pytest.mark.parametrize("mode", ["w", "gz"])
@pytest.mark.parametrize(
    "error",
    [
        ZeroDivisionError(),
        KeyboardInterrupt(),
        OSError(errno.ETIMEDOUT, "Connection timed out"),
        FileNotFoundError(errno.ENOENT, "No such file", "elsewhere"),
    ],
    ids=["arithmetic", "interrupt", "another device's", "another file's"],
)
def test_an_error_in_the_block_leaves_the_old_file(old: Path, mode: str, error: BaseException) -> None:
    def write_half() -> None:
        with replacing(str(old), mode) as stream:
            stream.write("half")
            raise error

    with pytest.raises(type(error)) as raised:
        write_half()
    assert raised.value is error
    assert_untouched(old)


@pytest.mark.parametrize("kind", ["missing", "file", "folder", "pipe"])
def test_what_cannot_be_written_is_refused_before_the_block_runs(tmp_path: Path, kind: str) -> None:
    """As root, a rename over /dev/null would break the machine; a pipe stands for it here."""
    path = tmp_path / "there"
    if kind == "file":
        path.write_text("old")
    elif kind == "folder":
        path.mkdir()
    elif kind == "pipe":
        os.mkfifo(path)
    target = path / "model.json" if kind in ("missing", "file") else path
    with pytest.raises(Refused, match=f"^{target}: cannot be written") as refused, replacing(str(target)):
        pytest.fail("the block must not run")
    reason = {"missing": "No such file or directory", "file": "Not a directory"}.get(kind, "a folder or a device")
    assert reason in refused.value.faults[0].problem
    assert os.listdir(tmp_path) == ([] if kind == "missing" else ["there"])
    assert kind != "file" or path.read_text() == "old"
    assert kind != "pipe" or stat.S_ISFIFO(path.stat().st_mode)


WRITE = """
import os, resource, signal, sys
from resource import setrlimit
from ambient_model.atomic import replacing
from ambient_model.faults import Refused

signal.signal(signal.SIGXFSZ, signal.SIG_IGN)

def attempt(mode):
    try:
        with replacing("model.json", mode) as stream:
            for _ in range(20):
                stream.write(os.urandom(20_000).hex())
    except Refused as refused:
        print(refused)
"""


OWN_MOUNTS = (["unshare", "--mount"], ["unshare", "--user", "--map-root-user", "--mount"])
"""Command prefixes that run another in mounts of its own, which vanish with it."""


def on_disk(options: str) -> list[str]:
    """A command prefix that runs another on a small file system of its own, which holds an old model."""
    for prefix in OWN_MOUNTS:
        probe = [*prefix, "mount", "-t", "tmpfs", "none", "/mnt"]
        if shutil.which("unshare") and subprocess.run(probe, capture_output=True).returncode == 0:
            mount = 'mount -t tmpfs -o size=64k none . && cd "$PWD" && echo old > model.json'
            return [*prefix, "sh", "-c", f'{mount} && mount -o remount,{options} . && "$@"; cat model.json; ls', "sh"]
    pytest.skip("no right to mount a small file system here")


@pytest.mark.parametrize(
    ("limit", "reason"),
    [
        ("size=64k", "(No space left on device)"),
        ("ro", "(Read-only file system)"),
        ("setrlimit(resource.RLIMIT_FSIZE, (50000, 50000))", "(File too large)"),
        ("import gzip; os.getuid() or os.seteuid(65534)", "(Permission denied)"),  # permissions do not stop root
    ],
)
def test_a_full_a_read_only_a_limited_and_a_closed_disk(old: Path, limit: str, reason: str) -> None:
    mounted = limit in ("size=64k", "ro")
    script = WRITE + ("" if mounted else f"{limit}\n") + "attempt('w')\nattempt('gz')"
    command = [*(on_disk(limit) if mounted else []), sys.executable, "-W", "error", "-c", script]
    old.parent.chmod(0o555 if "Permission" in reason else 0o755)
    try:
        done = subprocess.run(command, cwd=old.parent, capture_output=True, text=True, timeout=60)
    finally:
        old.parent.chmod(0o755)
    assert done.stderr == ""
    lines = done.stdout.splitlines()
    assert [line.startswith("model.json: ") and reason in line for line in lines[:2]] == [True, True]
    assert lines[2:] == (["old", "model.json"] if mounted else [])
    assert_untouched(old)
