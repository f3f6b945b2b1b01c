import errno
import gzip
import os
import shutil
import stat
import subprocess
import sys
from pathlib import Path

import pytest

from ambient_model.atomic import replacing
from ambient_model.faults import Refused

UNREAD = "an existing file was left as it was"


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


def test_gz_is_gzip(tmp_path: Path) -> None:
    path = tmp_path / "trace.csv.gz"
    with replacing(str(path), "gz") as stream:
        stream.write("time_s\n")
    assert gzip.decompress(path.read_bytes()) == b"time_s\n"
    assert os.listdir(tmp_path) == [path.name]


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


def test_a_missing_folder(tmp_path: Path) -> None:
    path = tmp_path / "none" / "model.json"
    with pytest.raises(Refused) as refused, replacing(str(path)):
        pytest.fail("the block must not run")
    message = "cannot be written (No such file or directory); make the folder first, or name another"
    assert str(refused.value) == f"{path}: {message}"
    assert os.listdir(tmp_path) == []


def test_a_file_in_the_place_of_the_folder(old: Path) -> None:
    path = old / "model.json"
    with pytest.raises(Refused) as refused, replacing(str(path)):
        pytest.fail("the block must not run")
    assert str(refused.value) == f"{path}: cannot be written (Not a directory); name a folder that exists"
    assert_untouched(old)


def test_a_folder_is_not_replaced(tmp_path: Path) -> None:
    with pytest.raises(Refused) as refused, replacing(str(tmp_path)):
        pytest.fail("the block must not run")
    assert str(refused.value) == f"{tmp_path}: cannot be written (it is a folder or a device); name a file"
    assert not list(tmp_path.parent.glob("*.part"))


def test_what_is_no_regular_file_is_not_replaced(tmp_path: Path) -> None:
    """As root, a rename over /dev/null would break the machine; a pipe stands in for it here."""
    path = tmp_path / "pipe"
    os.mkfifo(path)
    with pytest.raises(Refused, match="it is a folder or a device"), replacing(str(path)):
        pytest.fail("the block must not run")
    assert stat.S_ISFIFO(path.stat().st_mode)


WRITE = """
import os, resource, signal, sys
from ambient_model.atomic import replacing
from ambient_model.faults import Refused

def attempt(mode):
    try:
        with replacing("model.json", mode) as stream:
            for _ in range(20):
                stream.write(os.urandom(20_000).hex())
    except Refused as refused:
        print(refused)
"""


def attempts(folder: Path, script: str, *prefix: str) -> list[str]:
    """The lines that a child prints; it starts in ``folder`` with ``attempt(mode)`` defined."""
    command = [*prefix, sys.executable, "-W", "error", "-c", WRITE + script]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=60)
    assert done.stderr == ""
    return done.stdout.splitlines()


def own_mounts() -> list[str]:
    """A command prefix that runs another in mounts of its own, which vanish with it."""
    for prefix in (["unshare", "--mount"], ["unshare", "--user", "--map-root-user", "--mount"]):
        probe = [*prefix, "mount", "-t", "tmpfs", "none", "/mnt"]
        if shutil.which("unshare") and subprocess.run(probe, capture_output=True).returncode == 0:
            return prefix
    pytest.skip("no right to mount a small file system here")


def test_a_full_disk(old: Path) -> None:
    mount = 'mount -t tmpfs -o size=64k none . && cd "$PWD" && echo old > model.json && "$@"; cat model.json; ls'
    script = "attempt('w'); attempt('gz')"
    lines = attempts(old.parent, script, *own_mounts(), "sh", "-c", mount, "sh")
    message = (
        f"model.json: cannot be written (No space left on device); free some disk space and run it again; {UNREAD}"
    )
    assert lines == [message, message, "old", "model.json"]


def test_a_read_only_disk(old: Path) -> None:
    mount = 'mount -t tmpfs -o ro none . && cd "$PWD" && "$@"'
    lines = attempts(old.parent, "attempt('w')", *own_mounts(), "sh", "-c", mount, "sh")
    message = "cannot be written (Read-only file system); choose a file system that is not read-only"
    assert lines == [f"model.json: {message}"]


def test_a_file_size_limit(old: Path) -> None:
    script = """
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (50_000, 50_000))
attempt("w")
attempt("gz")
"""
    message = "cannot be written (File too large); see that the folder exists, is writable and has room"
    assert attempts(old.parent, script) == [f"model.json: {message}"] * 2
    assert_untouched(old)


def test_a_folder_without_the_right_to_write(old: Path) -> None:
    old.parent.chmod(0o555)
    script = """
if os.getuid() == 0:  # whom permissions do not stop
    os.seteuid(65534)
attempt("w")
"""
    try:
        lines = attempts(old.parent, script)
    finally:
        old.parent.chmod(0o755)
    message = "cannot be written (Permission denied); choose a folder that you may write to"
    assert lines == [f"model.json: {message}"]
    assert_untouched(old)
