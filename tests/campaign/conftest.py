"""A device on disk, the daemon on it as a real process, and a consumer that only looks at what is published.

Faults and time come through ``device.c``, a library that the process loads: the daemon is the one that is shipped.
Where there is no compiler, the cases that need it skip and say so.
"""

import contextlib
import errno
import itertools
import json
import math
import mmap
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from ambient_model.conformance import conformance_of
from ambient_model.model import Discrete, Estimator, Input, Model
from device import add_zone
from processes import content_of, ran, wait_until

from .observer import number_in

HERE = Path(__file__).parent
POISON_MILLIDEGC = 99000
PERIODS_S = (0.25, 0.5, 1.0)
"""Exact in binary, as all times of the campaign are: a tick comes when the clock says so, and not a rounding later."""
INPUTS = (
    Input("usb", "degC", "usb-therm", -40.0, 90.0),
    Input("battery", "degC", "battery", -40.0, 70.0),
    Input("soc", "degC", "cpu-0-0", -40.0, 110.0),
)
KINDS = ("usb-therm", "battery", "cpu-0-0")
LAG_S = 10.0
PATIENT = """
import sys
from ambientd.sources import reader
reader.PATIENCE_S = {}
from ambientd.__main__ import main
sys.exit(main())
"""
STATUSES = ("warming_up", "tracking", "degraded", "coasting", "faulted")


def estimator(inputs: tuple[Input, ...], direct: tuple[float, ...], offset: float, width: float) -> Estimator:
    """What the shell reads, less 0.3 of what the soc, the last input, was a while ago."""
    others = (0.0,) * len(direct)
    discrete = [
        Discrete(period_s, ((kept,),), ((*others, 1 - kept),), ((-0.3,),), ((*direct, 0.0),))
        for period_s, kept in ((each, math.exp(-each / LAG_S)) for each in PERIODS_S)
    ]
    bands = {50: (-width, width), 90: (-2 * width, 2 * width), 98: (-3 * width, 3 * width)}
    return Estimator(inputs, ("soc_lagged",), tuple(discrete), offset, ((*others, 1.0),), bands)


def made_model() -> Model:
    """Rests at v - 2 where all sensors rest at v; with a fallback without usb or battery, and none without soc."""
    usb, battery, soc = INPUTS
    main = estimator(INPUTS, (0.9, 0.4), -2.0, 0.3)
    without_usb, without_battery = ((battery, soc), (1.3,), -2.5, 1.0), ((usb, soc), (1.3,), -1.5, 1.0)
    others = {"usb": estimator(*without_usb), "battery": estimator(*without_battery)}
    steps = tuple((20.0 + k % 5, 21.0, 30.0 - 0.5 * k) for k in range(20))
    return Model("campaign", "2024-05-01", "ambient_degC", main, others, {}, conformance_of(main, steps))


_BOOT, _WALL, _DUE, _ASLEEP = range(4)


class Clock:
    """The page that ``device.c`` describes. A time is stored whole: the daemon reads it at any moment."""

    def __init__(self, path: Path, now_s: float = 1000.0) -> None:
        self.path = path
        path.write_bytes(bytes(4096))
        with open(path, "r+b") as stream:
            self._page = memoryview(mmap.mmap(stream.fileno(), 4096)).cast("q")
        self.now_s = now_s

    @property
    def now_s(self) -> float:
        return self._page[_BOOT] / 1e9

    @now_s.setter
    def now_s(self, value: float) -> None:
        self._page[_BOOT] = round(value * 1e9)

    def set_wall_back_s(self, by_s: float) -> None:
        self._page[_WALL] -= round(by_s * 1e9)

    def sleeper_waits(self) -> bool:
        """Whether the process sleeps, and until later than now."""
        return self._page[_ASLEEP] == 1 and self._page[_DUE] > self._page[_BOOT]

    def forget_sleeper(self) -> None:
        self._page[_ASLEEP] = 0


class Zones:
    """Thermal zones on disk. A temperature is written in place, as the kernel's seems to be: never seen empty."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self.folder = root / "class" / "thermal"
        self.folder.mkdir(parents=True)

    def add(self, number: int, kind: str, millidegC: int) -> None:
        add_zone(self.root, number, kind, f"{millidegC}\n")

    def find(self, kind: str) -> Path:
        return next(each for each in self.folder.iterdir() if (each / "type").read_text() == f"{kind}\n")

    def say(self, kind: str, content: int | bytes) -> None:
        with open(self.find(kind) / "temp", "r+b", buffering=0) as stream:
            stream.write(content if isinstance(content, bytes) else b"%d\n" % content)
            stream.truncate()

    def fail(self, kind: str, error: str = "", block_s: float = 0.0) -> None:
        """Let each read of it block for so long, or until :meth:`heal`, and then fail with ``error``."""
        folder = self.find(kind)
        number = getattr(errno, error) if error else 0
        (folder / "next").write_text(f"{number} {round(block_s * 1000)}\n")
        (folder / "next").rename(folder / "temp.fault")

    def heal(self, kind: str) -> None:
        (self.find(kind) / "temp.fault").unlink()

    def tries(self, kind: str) -> int:
        """How often it was read while something was wrong with it."""
        path = self.find(kind) / "temp.tries"
        return path.stat().st_size if path.exists() else 0

    def unplug(self, kind: str) -> None:
        """As a driver that is unbound: the folder goes, and whoever has the file open reads ENODEV from now on."""
        self.fail(kind, "ENODEV")
        self.find(kind).rename(self.root / f"gone-{kind}-{time.monotonic_ns()}")


@pytest.fixture
def zones(tmp_path: Path) -> Zones:
    """Three zones at rest: ambient is 28."""
    made = Zones(tmp_path / "sys")
    made.add(0, "cpu-0-0", 30000)
    made.add(3, "battery", 30000)
    made.add(10, "usb-therm", 30000)
    return made


class Outputs:
    """The folder that the daemon publishes in, seen by a consumer."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        folder.mkdir()
        self.temp, self.same, self.status_file, self.prometheus, self.socket = (
            folder / name for name in ("temp", "same", "status", "a.prom", "s")
        )

    def publish(self) -> list[Any]:
        return [
            {"kind": "file", "path": str(self.temp)},
            {"kind": "file", "path": str(self.same), "mode": "in-place", "poison_millidegC": POISON_MILLIDEGC},
            f"prometheus:{self.prometheus}",
            f"socket:{self.socket}",
            f"status:{self.status_file}",
        ]

    def status(self) -> dict[str, Any]:
        report: dict[str, Any] = json.loads(self.status_file.read_bytes())
        assert report["status"] in STATUSES
        return report

    def agreed(self) -> dict[str, Any]:
        """The status, after all that is published has been seen to say the same."""
        report = self.status()
        ambient = report["ambient_degC"]
        assert (ambient is None) == (report["status"] == "faulted")
        temp, same, prometheus = map(content_of, (self.temp, self.same, self.prometheus))
        scraped = re.search(rb"^ambientd_ambient_celsius\{[^}]*\} (\S+)$", prometheus, re.MULTILINE)
        if ambient is None:
            assert (temp, number_in(same), scraped) == (None, POISON_MILLIDEGC, None)
        else:
            assert report["low_degC"] < ambient < report["high_degC"]
            assert (number_in(temp), number_in(same)) == (round(ambient * 1000),) * 2
            assert float(scraped[1]) == ambient
        return report


class Daemon:
    """The running process; its log goes to a file, and its clock stands until it is moved."""

    def __init__(self, process: "subprocess.Popen[str]", outputs: Outputs, log_path: Path, clock: Clock):
        self.process = process
        self.outputs = outputs
        self._log_path = log_path
        self.clock = clock

    @property
    def log(self) -> list[str]:
        """What it said, after the line that it starts with."""
        return self._log_path.read_text().splitlines()[1:]

    @property
    def descriptors(self) -> int:
        return len(os.listdir(f"/proc/{self.process.pid}/fd"))

    @property
    def threads(self) -> int:
        return len(os.listdir(f"/proc/{self.process.pid}/task"))

    def tick(self, by_s: float = 1.0) -> None:
        """Let so much time pass at once, and the daemon do what it does then."""
        self.clock.now_s += by_s
        if by_s < 0:
            wait_until(lambda: self.outputs.status()["time_s"] <= self.clock.now_s, "it waits for the old time")
        wait_until(lambda: self.clock.sleeper_waits() or self.process.poll() is not None, "no tick came", 60.0)
        assert self.process.poll() is None, self._log_path.read_text()

    def step(self, by_s: float = 1.0) -> dict[str, Any]:
        """As :meth:`tick`; what everyone can then see."""
        self.tick(by_s)
        return self.outputs.agreed()

    def settled(self) -> dict[str, Any]:
        """What everyone can see once what is due has been done."""
        return self.step(0.0)

    def steps(self, count: int, by_s: float = 1.0) -> list[dict[str, Any]]:
        return [self.step(by_s) for _ in range(count)]

    @contextlib.contextmanager
    def suspended(self, for_s: float) -> Iterator[None]:
        """The whole device sleeps; what the block does has been done when it wakes."""
        os.kill(self.process.pid, signal.SIGSTOP)
        os.waitid(os.P_PID, self.process.pid, os.WSTOPPED | os.WNOWAIT)
        try:
            yield
            self.clock.now_s += for_s
        finally:
            os.kill(self.process.pid, signal.SIGCONT)

    def end(self) -> list[str]:
        """A clean end that leaves nothing behind; the log."""
        self.process.terminate()
        assert self.process.wait(30) == 0, self._log_path.read_text()
        assert os.listdir(self.outputs.folder) == []
        return self.log


@pytest.fixture(scope="session")
def device_library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    if compiler is None:
        pytest.skip("no C compiler: sensors that fail and a clock that moves need device.c")
    built = tmp_path_factory.mktemp("device") / "device.so"
    flags = ["-O1", "-Wall", "-shared", "-fPIC"]
    done = ran(compiler, *flags, HERE / "device.c", "-o", built, "-ldl", status=None)
    if done.returncode:
        pytest.skip(f"device.c does not compile here: {done.stderr.splitlines()[:1]}")
    return built


Start = Callable[..., Daemon]


@pytest.fixture
def model_file(saved: Callable[[Model], str]) -> str:
    return saved(made_model())


@pytest.fixture
def clock(tmp_path: Path) -> Clock:
    return Clock(tmp_path / "clock")


@pytest.fixture
def config(write: Callable[[str, str], str], model_file: str, zones: Zones) -> Callable[..., str]:
    """A configuration for the device at 1 Hz that publishes to some outputs, with some keys as given."""

    def written(outputs: Outputs, **keys: Any) -> str:
        data = {"model": model_file, "sysfs_root": str(zones.root), "rate_hz": 1, "publish": outputs.publish()}
        return write("ambientd.json", json.dumps({**data, **keys}))

    return written


@pytest.fixture
def patience_s(request: pytest.FixtureRequest) -> float:
    """How long the daemon waits for a sensor: long, so that a loaded machine fails no reading; or a module's own."""
    return getattr(request.module, "PATIENCE_S", 30.0)


@pytest.fixture
def start(tmp_path: Path, device_library: Path, clock: Clock, config, patience_s: float, spawn) -> Start:
    """The daemon on the device, at its first tick; its clock stands there until the test moves it."""
    numbers = itertools.count()
    env = {**os.environ, "LD_PRELOAD": str(device_library), "CAMPAIGN_CLOCK": str(clock.path)}

    def started(outputs: Outputs | None = None, log: int | None = None, **keys: Any) -> Daemon:
        number = next(numbers)
        outputs, log_path = outputs or Outputs(tmp_path / f"out-{number}"), tmp_path / f"log-{number}"
        call = [sys.executable, "-c", PATIENT.format(patience_s), "run", "--config", str(config(outputs, **keys))]
        clock.forget_sleeper()
        with open(log_path, "wb") as stream:
            process = spawn(call, stdout=None, stderr=stream if log is None else log, env=env)
        daemon = Daemon(process, outputs, log_path, clock)
        daemon.settled()
        return daemon

    return started


@pytest.fixture
def tracking(start: Start) -> Daemon:
    """The daemon, settled."""
    daemon = start()
    assert daemon.steps(40)[-1]["status"] == "tracking"
    return daemon
