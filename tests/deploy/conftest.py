"""The daemon as it is deployed: one file, run in an empty environment by an isolated interpreter."""

import contextlib
import itertools
import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from device import add_zone
from processes import ran, under

ROOT = Path(__file__).resolve().parents[2]
DEPLOY = ROOT / "deploy"


@pytest.fixture(scope="session")
def build() -> Callable[..., str]:
    """Run one of the build scripts in ``deploy``, which has nothing to complain of: what it prints."""

    def run(script: str, *arguments: object) -> str:
        # as someone would who has nothing but this checkout
        done = ran(sys.executable, DEPLOY / script, *arguments, env={"PYTHONDONTWRITEBYTECODE": "1"})
        assert done.stderr == ""
        return done.stdout

    return run


@pytest.fixture(scope="session")
def program() -> Callable[[str], str]:
    """The path of a program; where it is not installed, the test skips."""
    path = f"{os.environ.get('PATH', '')}:/usr/sbin:/sbin:/usr/local/sbin"
    return lambda name: shutil.which(name, path=path) or pytest.skip(f"{name} is not installed")


@pytest.fixture(scope="session")
def zipapp(build, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The daemon in one file."""
    path = tmp_path_factory.mktemp("zipapp") / "ambientd.pyz"
    build("build_zipapp.py", "-o", path)
    return path


@pytest.fixture(scope="session")
def model_file() -> Path:
    """A model that says v - 1.5 when both of its sensors, usb and battery, rest at v."""
    return ROOT / "tests" / "data" / "model-v1.json"


@pytest.fixture
def deployed(zipapp: Path) -> Callable[..., list[str]]:
    """The words that run a command of the deployed daemon."""
    return lambda *arguments: [sys.executable, "-I", "-S", str(zipapp), *map(str, arguments)]


Spawn = Callable[..., "subprocess.Popen[str]"]


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

    def say(self, ambient_degC: float | None, rows: int = 60) -> None:
        """Let it be as warm as that for as many seconds of the trace, long enough for the model to settle.

        With None, both sensors are lost, for longer than last values may stand in for them.
        """
        value = "" if ambient_degC is None else repr(ambient_degC + 1.5)
        lines = [f"{time_s},{value},{value}\n" for time_s in itertools.islice(self._times_s, rows)]
        os.write(self._pipe, "".join(lines).encode())

    def close(self) -> None:
        """End the trace, and with it the daemon."""
        if self._pipe >= 0:
            os.close(self._pipe)
            self._pipe = -1

    def kill(self) -> None:
        """End the daemon as one that runs out of memory."""
        self._daemon.kill()
        self._daemon.wait()


@pytest.fixture
def weather(tmp_path: Path) -> Iterator[Weather]:
    """A trace to be replayed that says what the test says."""
    with contextlib.closing(Weather(tmp_path / "trace.csv")) as made:
        yield made


@pytest.fixture(scope="session")
def at_rest() -> Callable[[Path], Path]:
    """Make a fake sysfs whose sensors rest at 24.5 degC: the ambient is 23."""

    def make(root: Path) -> Path:
        for number, kind in enumerate(["cpu-0-0", "battery", "usb-therm"]):
            add_zone(root, number, kind, "24500\n")
        return root

    return make


@pytest.fixture
def phone(at_rest: Callable[[Path], Path], tmp_path: Path) -> Path:
    """A fake sysfs whose sensors rest at 24.5 degC: the ambient is 23."""
    return at_rest(tmp_path / "sys")


class Machine:
    """A systemd in namespaces of its own, with a copy-on-write view of this machine's files."""

    def __init__(self, box: Path, init: int) -> None:
        self.box = box
        """A folder outside that is ``/box`` inside."""
        self._init = init

    def run(self, *words: object, check: bool = True) -> str:
        """What a command says inside."""
        path = "PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin"
        enter = ["nsenter", "-t", str(self._init), "-m", "-p", "-u", "-i", "-C", "env", "-i", path]
        return ran(*enter, *words, status=0 if check else None).stdout

    def show(self, name: str) -> str:
        """A property of the unit."""
        return self.run("systemctl", "show", "-P", name, "ambientd").strip()

    def file(self, path: str) -> Path:
        """The way from outside to a file inside."""
        return Path(f"/proc/{self._init}/root{path}")


@pytest.fixture(scope="session")
def boot(program, until: Callable[..., None]) -> "Callable[[Path], contextlib.AbstractContextManager[Machine]]":
    """Boot a systemd on a folder, whose ``units`` and ``files`` it finds in its own file system."""
    for name in ("unshare", "nsenter", "setpriv", "systemctl"):
        program(name)
    if os.geteuid() != 0:
        pytest.skip("only root boots a systemd")
    fit = "import sys; sys.exit(sys.version_info < (3, 10))"
    if not os.path.exists("/usr/bin/python3") or subprocess.run(["/usr/bin/python3", "-c", fit]).returncode != 0:
        pytest.skip("the one file is run by /usr/bin/python3, and that is not 3.10 or newer")
    return lambda box: _booted(box, until)


@contextlib.contextmanager
def _booted(box: Path, until: Callable[..., None]) -> Iterator[Machine]:
    (box / "units").mkdir(exist_ok=True)
    (box / "units" / "box.target").write_text("[Unit]\nDescription=All that runs here\n")
    script = Path(__file__).with_name("boot.sh")
    with (box / "log").open("w") as log:
        # it ends with the test, however that ends
        words = ["setpriv", "--pdeathsig", "TERM", "unshare", "--mount", "--propagation", "private", script, box]
        process = subprocess.Popen(words, stdout=log, stderr=log, stdin=subprocess.DEVNULL)

    def init() -> int | None:
        return next((pid for pid, name in under(process.pid, "name").items() if name == "systemd"), None)

    def is_up() -> bool:
        if process.poll() is not None:
            return True
        pid = init()
        asked = pid and Machine(box, pid).run("systemctl", "is-system-running", check=False).strip()
        return asked in ("running", "degraded")

    try:
        with contextlib.suppress(AssertionError):
            until(is_up)
        pid = init() if process.poll() is None else None
        if pid is None:
            pytest.skip(f"no systemd can be booted here: {(box / 'log').read_text().strip()[-300:]}")
        yield Machine(box, pid)
    finally:
        process.terminate()
        process.wait(timeout=20)
