"""The daemon as it is deployed: one file, run in an empty environment by an isolated interpreter."""

import contextlib
import itertools
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
DEPLOY = ROOT / "deploy"


@pytest.fixture(scope="session")
def build() -> "Callable[..., subprocess.CompletedProcess[str]]":
    """Run one of the build scripts in ``deploy``."""

    def run(script: str, *arguments: object) -> "subprocess.CompletedProcess[str]":
        # as someone would who has nothing but this checkout
        call = [sys.executable, str(DEPLOY / script), *map(str, arguments)]
        return subprocess.run(call, env={"PYTHONDONTWRITEBYTECODE": "1"}, capture_output=True, text=True, timeout=60)

    return run


@pytest.fixture(scope="session")
def zipapp(build, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The daemon in one file."""
    path = tmp_path_factory.mktemp("zipapp") / "ambientd.pyz"
    done = build("build_zipapp.py", "-o", path)
    assert (done.returncode, done.stderr) == (0, "")
    return path


@pytest.fixture
def model_file() -> Path:
    """A model that says v - 1.5 when both of its sensors, usb and battery, rest at v."""
    return ROOT / "tests" / "data" / "model-v1.json"


@pytest.fixture
def deployed(zipapp: Path) -> Callable[..., list[str]]:
    """The words that run a command of the deployed daemon."""
    return lambda *arguments: [sys.executable, "-I", "-S", str(zipapp), *map(str, arguments)]


Spawn = Callable[..., "subprocess.Popen[str]"]


@pytest.fixture
def spawn() -> "Iterator[Spawn]":
    """Start a process with its standard error in its output; what still runs at the end of the test is killed."""
    running: list[subprocess.Popen[str]] = []

    def started(words: list[str], **options: object) -> "subprocess.Popen[str]":
        streams = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "stdin": subprocess.DEVNULL}
        process: subprocess.Popen[str] = subprocess.Popen(words, text=True, **{**streams, **options})
        running.append(process)
        return process

    yield started
    for process in running:
        process.kill()
        process.wait()
        if process.stdout:
            process.stdout.close()


@pytest.fixture
def until() -> Callable[..., None]:
    """Wait until a condition holds; the limit only ends a test that has failed."""

    def wait(condition: Callable[[], object], why: str = "waited in vain", seconds: float = 20.0) -> None:
        end = time.monotonic() + seconds
        while not condition():
            assert time.monotonic() < end, why
            time.sleep(0.01)

    return wait


class Weather:
    """A trace that is written while the daemon replays it, row by row: the daemon says what the test last said."""

    def __init__(self, pipe: Path) -> None:
        self.trace = pipe
        self._times_s = itertools.count()
        os.mkfifo(pipe)
        # for reading too: a daemon that ends before it reads must not leave the test waiting for a reader
        self._pipe = os.open(pipe, os.O_RDWR)

    def start(self, spawn: Spawn, words: list[str], ambient_degC: float) -> None:
        """Run ``words``, the daemon on :attr:`trace`, in a world at rest at ``ambient_degC``."""
        self._daemon = spawn(words, env={}, stdout=subprocess.DEVNULL, stderr=None)
        os.write(self._pipe, b"time_s,usb_degC,battery_degC\n")
        self.say(ambient_degC, rows=240)  # a replay reads 200 rows ahead, to learn their period

    def say(self, ambient_degC: float, rows: int = 60) -> None:
        """Let it be as warm as that for as many seconds of the trace, long enough for the model to settle."""
        value = ambient_degC + 1.5
        lines = [f"{time_s},{value!r},{value!r}\n" for time_s in itertools.islice(self._times_s, rows)]
        os.write(self._pipe, "".join(lines).encode())

    def close(self) -> None:
        """End the trace, and with it the daemon."""
        if self._pipe >= 0:
            os.close(self._pipe)
            self._pipe = -1

    def end(self) -> int:
        """End the trace, and with it the daemon: its exit status."""
        self.close()
        return self._daemon.wait(timeout=20)


@pytest.fixture
def weather(tmp_path: Path) -> Iterator[Weather]:
    """A trace to be replayed that says what the test says."""
    with contextlib.closing(Weather(tmp_path / "trace.csv")) as made:
        yield made


@pytest.fixture
def phone(tmp_path: Path) -> Path:
    """A fake sysfs whose sensors rest at 24.5 degC: the ambient is 23."""
    for number, kind in enumerate(["cpu-0-0", "battery", "usb-therm"]):
        folder = tmp_path / "sys" / "class" / "thermal" / f"thermal_zone{number}"
        folder.mkdir(parents=True)
        (folder / "type").write_text(f"{kind}\n")
        (folder / "temp").write_text("24500\n")
    return tmp_path / "sys"


@pytest.fixture
def children() -> Callable[[int], dict[int, str]]:
    """The commands of the processes that a process has started, by their numbers."""

    def of(parent: int) -> dict[int, str]:
        found = {}
        for folder in Path("/proc").glob("[0-9]*"):
            with contextlib.suppress(OSError):  # it has ended meanwhile
                words_after_name = (folder / "stat").read_text().rpartition(")")[2].split()
                if int(words_after_name[1]) == parent:
                    found[int(folder.name)] = (folder / "cmdline").read_text().replace("\0", " ")
        return found

    return of
