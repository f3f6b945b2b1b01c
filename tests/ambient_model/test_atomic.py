import errno
import os
import stat
import sys
from pathlib import Path

import pytest

from ambient_model.atomic import replacing
from ambient_model.faults import Refused
from processes import ran


@pytest.fixture
def old(write) -> Path:
    return Path(write("model.json", "old"))


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
import os, signal
from resource import RLIMIT_FSIZE, setrlimit
from ambient_model.atomic import replacing
from ambient_model.faults import Refused

signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
setrlimit(RLIMIT_FSIZE, (50000, 50000))
for mode in ("w", "gz"):
    try:
        with replacing("model.json", mode) as stream:
            for _ in range(20):
                stream.write(os.urandom(20_000).hex())
    except Refused as refused:
        print(refused)
"""


def test_a_disk_that_takes_no_more_leaves_the_old(old: Path) -> None:
    done = ran(sys.executable, "-W", "error", "-c", WRITE, cwd=old.parent)
    assert done.stderr == ""
    reason = "model.json: cannot be written (File too large)"
    assert [line.startswith(reason) for line in done.stdout.splitlines()] == [True, True]
    assert_untouched(old)
