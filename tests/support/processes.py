"""Commands that run to their end, and what others take of the machine."""

import contextlib
import socket
import subprocess
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import psutil

Done = subprocess.CompletedProcess[str]


def ran(*words: object, status: int | None = 0, timeout: float | None = 60, **options: Any) -> Done:
    """What a command did; the test fails where its status is another than ``status``, None for any."""
    options = {"capture_output": True, "text": True, **options}
    done = subprocess.run([*map(str, words)], timeout=timeout, **options)
    assert status in (None, done.returncode), (done.stdout or "")[-2000:] + (done.stderr or "")[-2000:]
    return done


def wait_until(condition: Callable[[], object], why: str = "waited in vain", seconds: float = 20.0) -> None:
    """Wait until a condition holds; the limit only ends a test that has failed."""
    end_s = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end_s, why
        time.sleep(0.001)


def free_port() -> int:
    """A TCP port that nobody has."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        return int(free.getsockname()[1])


def is_listening(at: int | str) -> bool:
    """Whether somebody answers at a TCP port, or at the path of a socket."""
    with socket.socket(socket.AF_UNIX if isinstance(at, str) else socket.AF_INET) as asked:
        return not asked.connect_ex(at if isinstance(at, str) else ("127.0.0.1", at))


def content_of(path: Path) -> bytes | None:
    """What a file holds; None where there is none."""
    try:
        return path.read_bytes()
    except FileNotFoundError:
        return None


def resident_kB(pid: int) -> int:
    """The memory that a process holds."""
    return int(psutil.Process(pid).memory_info().rss) // 1024


def under(pid: int, what: str) -> dict[int, Any]:
    """The ``name`` or the ``cmdline`` of the processes under a process, by their numbers."""
    found = {}
    for each in psutil.Process(pid).children(recursive=True):
        with contextlib.suppress(psutil.Error):  # it has ended meanwhile
            found[each.pid] = getattr(each, what)()
    return found
