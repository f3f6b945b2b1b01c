"""Property tests that draw the same examples every time; the command line and model files."""

import contextlib
import functools
import importlib
import json
import os
import pty
import select
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

import pytest
from hypothesis import settings
from threadpoolctl import threadpool_limits

from broker import Broker
from processes import wait_until

if TYPE_CHECKING:
    from ambient_model.model import Model

settings.register_profile("same", derandomize=True, deadline=None, database=None)
settings.load_profile("same")

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    # tests that run in a shell's background ignore Ctrl-C, and so would every program that they start
    signal.signal(signal.SIGINT, signal.default_int_handler)

SLOW_LIMIT_S = 900.0


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """A slow test may take longer than pyproject.toml gives to each."""
    for item in items:
        if item.get_closest_marker("slow") and not item.get_closest_marker("timeout"):
            item.add_marker(pytest.mark.timeout(SLOW_LIMIT_S))


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers() -> int:
    """Half as many workers again as cores, as a third of the tests' time is waiting for programs that they started."""
    return max(1, len(os.sched_getaffinity(0)) * 3 // 2)


@pytest.fixture(autouse=True, scope="session")
def _one_thread() -> Iterator[None]:
    """Four BLAS threads make the algebra of 5 x 5 matrices many times slower."""
    with threadpool_limits(1):
        yield


@pytest.fixture
def write(tmp_path: Path) -> Callable[[str, str], str]:
    """Writes a file in the folder of the test, to the letter, and returns its path."""

    def written(name: str, text: str) -> str:
        (tmp_path / name).write_text(text, encoding="utf-8", newline="")
        return str(tmp_path / name)

    return written


MAINS = {"ambient-trainer": "ambient_trainer.cli.main", "ambientd": "ambientd.__main__"}


@pytest.fixture
def call(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Callable[..., tuple[Any, str, str]]:
    """Runs a command line in this process and returns its status, its output and its messages."""

    def run(program: str, *arguments: object) -> tuple[Any, str, str]:
        monkeypatch.setattr(sys, "argv", [program, *map(str, arguments)])
        try:
            status = importlib.import_module(MAINS[program]).main() or 0
        except SystemExit as left:
            status = left.code or 0
        return (status, *capsys.readouterr())

    return run


@pytest.fixture
def trainer(call: Callable[..., tuple[Any, str, str]]) -> Callable[..., tuple[Any, str, str]]:
    """As ``call``, of ``ambient-trainer``."""
    return functools.partial(call, "ambient-trainer")


@pytest.fixture
def figures(trainer: Callable[..., tuple[Any, str, str]], tmp_path: Path) -> Callable[..., tuple[Any, str]]:
    """Runs a command of ``ambient-trainer`` that has nothing to complain of: its ``--json``, and what it prints."""

    def run(*arguments: object) -> tuple[Any, str]:
        status, printed, said = trainer(*arguments, "--json", tmp_path / "figures.json")
        assert (status, said) == (0, "")
        return json.loads((tmp_path / "figures.json").read_text()), printed

    return run


@pytest.fixture
def interrupted(tmp_path: Path) -> Callable[..., tuple[int, str, str]]:
    """Runs a command on a terminal, where bars show, with Ctrl-C once that shows a word: status, output, messages.

    With ``view``, the terminal shows its standard output, and the messages are what is printed elsewhere.
    """

    def run(word: str, *arguments: object, view: bool = False) -> tuple[int, str, str]:
        terminal, end = pty.openpty()
        command = [sys.executable, "-m", "ambient_trainer", *map(str, arguments)]
        with open(tmp_path / "printed", "w+") as printed:
            streams = {"stdout": end, "stderr": printed} if view else {"stdout": printed, "stderr": end}
            process = subprocess.Popen(command, **streams, start_new_session=True)
            os.close(end)
            shown, sent, limit_s = b"", False, time.monotonic() + 100
            try:
                while process.poll() is None:
                    assert time.monotonic() < limit_s, shown.decode()
                    shown += _read(terminal, 0.1)
                    if word.encode() in shown and not sent:
                        os.killpg(process.pid, signal.SIGINT)
                        sent = True
                while more := _read(terminal, 0.0):
                    shown += more
            finally:
                with contextlib.suppress(ProcessLookupError):
                    os.killpg(process.pid, signal.SIGKILL)
                process.wait(10)
                os.close(terminal)
            printed.seek(0)
            # Python itself ends by the signal where that came amid an exec(), such as a dataclass that is being made
            status = 1 if process.returncode == -signal.SIGINT else process.returncode
            return status, printed.read(), shown.decode()

    return run


def _read(terminal: int, patience_s: float) -> bytes:
    if not select.select([terminal], [], [], patience_s)[0]:
        return b""
    with contextlib.suppress(OSError):  # no process has its other end
        return os.read(terminal, 4096)
    time.sleep(patience_s)
    return b""


BESIDE = Path(__file__).parents[2] / "shared"


@pytest.fixture(scope="session")
def beside() -> Callable[[str], Path]:
    """The path of what others measured, wrote or built; where it is not beside the repository, the test skips."""

    def find(place: str) -> Path:
        path = BESIDE / place
        return path if path.exists() else pytest.skip(f"{path} is not there")

    return find


@pytest.fixture(scope="session")
def until() -> Callable[..., None]:
    """Waits until a condition holds; the limit only ends a test that has failed."""
    return wait_until


@pytest.fixture
def broker(tmp_path: Path) -> Iterator[Broker]:
    """A running mosquitto; where there is none, the test skips."""
    made = Broker(tmp_path)
    yield made
    made.stop()


@pytest.fixture(scope="module")
def memory() -> Iterator[Path]:
    """A folder in memory, as /run and sysfs are, where there is one: a disk takes an hour for a million renames."""
    with tempfile.TemporaryDirectory(dir="/dev/shm" if os.access("/dev/shm", os.W_OK) else None) as folder:
        yield Path(folder)


@pytest.fixture
def public() -> Iterator[str]:
    """A folder that everyone may enter; pytest's own are closed to others. It is to outlive who publishes there."""
    with tempfile.TemporaryDirectory() as folder:
        os.chmod(folder, 0o755)
        yield folder


Spawn = Callable[..., "subprocess.Popen[str]"]


@pytest.fixture
def spawn() -> Iterator[Spawn]:
    """Start a process with its standard error in its output; what still runs at the end of the test is killed."""
    running: list[subprocess.Popen[str]] = []

    def started(words: Sequence[object], **options: Any) -> "subprocess.Popen[str]":
        streams = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "stdin": subprocess.DEVNULL}
        running.append(subprocess.Popen([*map(str, words)], text=True, **{**streams, **options}))
        return running[-1]

    yield started
    for process in running:
        process.kill()
        process.wait()
        for stream in (process.stdin, process.stdout, process.stderr):
            if stream:
                stream.close()


@pytest.fixture
def listen() -> Iterator[Callable[[object], TextIO]]:
    """Connects to a daemon's socket and returns its lines."""
    with contextlib.ExitStack() as stack:

        def connected(path: object) -> TextIO:
            reader = stack.enter_context(socket.socket(socket.AF_UNIX))
            reader.connect(str(path))  # with a timeout, it would not wait where the kernel's queue is full
            reader.settimeout(8)
            return stack.enter_context(reader.makefile())

        yield connected


@pytest.fixture
def saved(tmp_path: Path) -> "Callable[[Model], str]":
    from ambient_model.codec import save_model

    def save(model: "Model") -> str:
        path = str(tmp_path / "model.json")
        save_model(path, model)
        return path

    return save
