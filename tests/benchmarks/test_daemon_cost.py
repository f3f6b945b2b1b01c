"""What the daemon costs a device, measured on its process from outside, beside a loop that does nothing else.

All processes of a rate run at the same time, so that what else the machine does is the same for all, but tick one
after the other. A tick's CPU time is what the process clock has moved by between two rests.
"""

from __future__ import annotations

import contextlib
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from ambient_model.codec import save_model
from ambient_model.model import ErrorVariance, Model, Secondary, Term

ROOT = Path(__file__).parents[2]
BARE = Path(__file__).parent / "bare_loop.py"
MEASURED_S = {1.0: 60.0, 10.0: 30.0}
LOOKS_PER_TICK = 4
"""Few, so that looking keeps nothing awake."""
STARTS = 7
OTHERS = [path for minor in range(10, 16) if (path := shutil.which(f"python3.{minor}"))]
"""Other interpreters on the path, whose memory is told for information."""

Command = Callable[[float, str], list[str]]
"""From a rate in Hz and the file to write to a command line."""


class Device(NamedTuple):
    """A fake sysfs with what the model reads, and the files of a daemon on it."""

    folder: Path
    zones: tuple[Path, ...]
    archive: Path
    """The daemon as one file,"""
    compiled: Path
    """and as one with this interpreter's byte code."""
    plain: Path
    """A model without fallbacks,"""
    full: Path
    """with one for each input,"""
    guarded: Path
    """and with guard and spread besides."""

    def packed(self, python: str, archive: Path, model: Path) -> Command:
        """The daemon as one file."""
        return self._daemon([python, "-I", "-S", str(archive)], model)

    def installed(self, model: Path) -> Command:
        """The daemon as the console script of this environment."""
        return self._daemon([str(Path(sys.executable).parent / "ambientd")], model)

    def _daemon(self, program: list[str], model: Path) -> Command:
        rest = ["run", "--model", str(model), "--sysfs-root", str(self.folder / "sys")]
        return lambda rate_hz, target: [*program, *rest, "--rate", str(rate_hz), "--publish", f"file:{target}"]

    def bare(self, rate_hz: float, target: str) -> list[str]:
        """The loop to compare with."""
        return [sys.executable, "-I", "-S", str(BARE), str(rate_hz), target, *map(str, self.zones)]


@pytest.fixture(scope="module")
def device(model: Model, tmp_path_factory: pytest.TempPathFactory) -> Device:
    """In memory, where sysfs and /run are, too."""
    memory = Path("/dev/shm")
    folder = tmp_path_factory.mktemp("device")
    if os.access(memory, os.W_OK):
        folder = memory / f"ambientd-cost-{os.getpid()}"
        folder.mkdir()
    zones = []
    for index, each in enumerate(model.main.inputs):
        zone = folder / "sys" / "class" / "thermal" / f"thermal_zone{index}"
        zone.mkdir(parents=True)
        (zone / "type").write_text(f"{each.zone}\n")
        (zone / "temp").write_text(f"{25_000 + 1_111 * index}\n")
        zones.append(zone / "temp")
    save_model(str(folder / "plain.json"), model._replace(fallbacks={}))
    save_model(str(folder / "full.json"), model)
    save_model(str(folder / "guarded.json"), _guarded(model))
    archive, compiled = folder / "ambientd.pyz", folder / "compiled.pyz"
    build = [sys.executable, str(ROOT / "deploy" / "build_zipapp.py"), "-o"]
    subprocess.run([*build, str(archive)], check=True, capture_output=True)
    subprocess.run([*build, str(compiled), "--compiled"], check=True, capture_output=True)
    yield Device(
        folder, tuple(zones), archive, compiled, *(folder / f"{each}.json" for each in ("plain", "full", "guarded"))
    )
    shutil.rmtree(folder)


def _guarded(model: Model) -> Model:
    """The same with a guard as large as the main estimator, which never has a say: what it costs is the same."""
    terms = (Term("movement", 300.0, 0.5), Term("guard", 60.0, 0.25))
    variance = ErrorVariance(0.25, terms, model.main.interval)
    return model._replace(secondary=Secondary(model.main, 1.0), error_variance=variance)


@contextlib.contextmanager
def _running(command: list[str]) -> Iterator[subprocess.Popen[bytes]]:
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        yield process
        assert process.poll() is None, "it ended by itself"
    finally:
        process.kill()
        process.wait()


def _cpu_s(process: subprocess.Popen[bytes]) -> float:
    """The CPU time of a process, to the nanosecond: its clock's number is made as Linux makes it."""
    return time.clock_gettime((~process.pid << 3) | 2)


def _rss_MB(process: subprocess.Popen[bytes]) -> float:
    status = Path(f"/proc/{process.pid}/status").read_text()
    return int(status.partition("VmRSS:")[2].split()[0]) / 1024


def _first_value_s(command: list[str], target: Path) -> float:
    """From the start of the process to the file that it publishes."""
    target.unlink(missing_ok=True)
    start_s = time.monotonic()
    with _running(command):
        while not target.exists():
            assert time.monotonic() < start_s + 30, "nothing is published"
            time.sleep(0.0005)
        return time.monotonic() - start_s


def _ticks_s(processes: list[subprocess.Popen[bytes]], rate_hz: float, for_s: float) -> list[list[float]]:
    """Per process the CPU time of each tick in s: looks that find the clock moved belong together."""
    ticks: list[list[float]] = [[] for _ in processes]
    before = [_cpu_s(process) for process in processes]
    moving = [False] * len(processes)
    end_s = time.monotonic() + for_s
    while time.monotonic() < end_s:
        time.sleep(1 / rate_hz / LOOKS_PER_TICK)
        for index, process in enumerate(processes):
            now = _cpu_s(process)
            if now > before[index]:
                if moving[index]:
                    ticks[index][-1] += now - before[index]
                else:
                    ticks[index].append(now - before[index])
            moving[index] = now > before[index]
            before[index] = now
    return ticks


@pytest.fixture(scope="module")
def subjects(device: Device) -> dict[str, Command]:
    return {
        "bare loop": device.bare,
        "one file, no fallbacks": device.packed(sys.executable, device.archive, device.plain),
        "one file, 4 fallbacks": device.packed(sys.executable, device.archive, device.full),
        "the same, guard and spread": device.packed(sys.executable, device.archive, device.guarded),
        "compiled, 4 fallbacks": device.packed(sys.executable, device.compiled, device.full),
        "installed, 4 fallbacks": device.installed(device.full),
    }


@pytest.mark.benchmark(group="daemon")
@pytest.mark.parametrize("rate_hz", MEASURED_S)
def test_a_device_s_hour(rate_hz, subjects, device, benchmark, noted):
    def measured() -> tuple[list[list[float]], list[float]]:
        with contextlib.ExitStack() as stack:
            processes = []
            for index, command in enumerate(subjects.values()):
                target = str(device.folder / f"out{index}")
                processes.append(stack.enter_context(_running(command(rate_hz, target))))
                time.sleep(1.237 / rate_hz)  # not all at the same moment
            time.sleep(1)
            return _ticks_s(processes, rate_hz, MEASURED_S[rate_hz]), [_rss_MB(each) for each in processes]

    ticks, rss_MB = benchmark.pedantic(measured, rounds=1)
    hours_s = [sum(each) / MEASURED_S[rate_hz] * 3600 for each in ticks]
    for name, hour_s, each, MB in zip(subjects, hours_s, ticks, rss_MB):
        p50, p99 = np.percentile(each, [50, 99]) * 1e6
        result = (
            f"{hour_s:.2f} CPU s an hour ({hour_s / hours_s[0]:.2f} x bare), tick p50 {p50:.0f} us, p99 {p99:.0f} us"
        )
        noted(f"{rate_hz:g} Hz, 4 zones to 1 file", name, MEASURED_S[rate_hz], f"{result}, VmRSS {MB:.1f} MB")
    for each in ticks:
        assert len(each) == pytest.approx(rate_hz * MEASURED_S[rate_hz], rel=0.1, abs=2)


@pytest.mark.benchmark(group="daemon")
@pytest.mark.parametrize(
    "name", ["bare loop", "one file, 4 fallbacks", "compiled, 4 fallbacks", "installed, 4 fallbacks"]
)
def test_the_first_estimate(name, subjects, device, benchmark, noted):
    target = device.folder / "first"
    found = []
    benchmark.pedantic(
        lambda: found.append(_first_value_s(subjects[name](1.0, str(target)), target)), rounds=STARTS, iterations=1
    )
    worst = f"of {STARTS}, worst {max(found):.3f} s"
    noted("start to first value", name, float(np.median(found)), worst)


@pytest.mark.benchmark(group="daemon")
@pytest.mark.parametrize("python", OTHERS)
def test_other_interpreters(python, device, benchmark, noted):
    version = subprocess.run([python, "-V"], capture_output=True, text=True)
    if version.returncode != 0:
        pytest.skip(f"{python} does not run")

    def measured() -> tuple[float, float]:
        target = device.folder / "other"
        with _running([python, "-I", "-S", str(BARE), "10", str(target), str(device.zones[0])]) as process:
            time.sleep(1)
            bare_MB = _rss_MB(process)
        with _running(device.packed(python, device.archive, device.full)(10.0, str(target))) as process:
            time.sleep(2)
            return bare_MB, _rss_MB(process)

    bare_MB, MB = benchmark.pedantic(measured, rounds=1)
    task = f"{version.stdout.strip()}, for information"
    noted(task, "one file, 4 fallbacks", 2, f"VmRSS {MB:.1f} MB, bare loop {bare_MB:.1f} MB")
