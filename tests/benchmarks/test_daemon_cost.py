"""What the daemon costs a device, measured on its process from outside, beside a loop that does nothing else.

All processes of a rate run at the same time, so that what else the machine does is the same for all, but tick one
after the other. A tick's CPU time is what the process clock has moved by between two rests. The zones read what a
simulated phone's do, in tenths of a degree and once a second, as sensors that stand still cost less.
"""

import contextlib
import json
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from ambient_model.codec import save_model
from ambient_model.model import ErrorVariance, Model, Secondary, Term
from ambient_trainer.simulator.simulate import simulate
from device import add_zone
from processes import resident_kB, wait_until

ROOT = Path(__file__).parents[2]
BARE = Path(__file__).parent / "bare_loop.py"
MEASURED_S = {1.0: 60.0, 10.0: 30.0}
LOOKS_PER_TICK = 4
"""Few, so that looking keeps nothing awake."""
STARTS = 7
COUNTED_HZ = 2.0
"""Slow enough for valgrind: a tick that comes late takes several times as many instructions."""
COUNTED_S = 12.0
SETTLED_S = 8.0
"""By then the first samples, which take more, and the first state are done."""

Command = Callable[[float, str], list[str]]
"""From a rate in Hz and the file to write to a command line."""


@pytest.fixture(scope="module")
def subjects(model: Model, memory: Path) -> dict[str, Command]:
    """The bare loop and the daemon in its builds, on a fake sysfs with what the model reads."""
    inputs = enumerate(model.main.inputs)
    zones = [str(add_zone(memory / "sys", index, each.zone) / "temp") for index, each in inputs]
    # a secondary estimator as large as the main one, which never takes precedence: what it costs is the same
    variance = ErrorVariance(0.25, (Term("movement", 300.0, 0.5), Term("guard", 60.0, 0.25)), model.main.interval)
    readings = model.readings._replace(starts=model.readings.starts[:1] * 2)
    secondary = Secondary(model.main, 1.0)
    validated = model._replace(fallbacks={}, secondary=secondary, error_variance=variance, readings=readings)
    fallbacks = model._replace(readings=None)
    named = {"plain": fallbacks._replace(fallbacks={}), "fallbacks": fallbacks, "validated": validated}
    for name, model_ in named.items():
        save_model(str(memory / f"{name}.json"), model_)
    packed, compiled = ([sys.executable, "-I", "-S", str(memory / name)] for name in ("ambientd.pyz", "compiled.pyz"))
    build = [sys.executable, str(ROOT / "deploy" / "build_zipapp.py"), "-o"]
    subprocess.run([*build, packed[-1]], check=True, capture_output=True)
    subprocess.run([*build, compiled[-1], "--compiled"], check=True, capture_output=True)
    installed = [str(Path(sys.executable).parent / "ambientd")]

    def daemon(program: list[str], name: str) -> Command:
        rest = ["run", "--model", str(memory / f"{name}.json"), "--sysfs-root", str(memory / "sys")]
        return lambda rate_hz, target: [*program, *rest, "--rate", str(rate_hz), "--publish", f"file:{target}"]

    (memory / "room").write_text("21.5 0.5\n")

    def with_all(rate_hz: float, target: str, **more: object) -> list[str]:
        outputs = more.pop("publish", [f"file:{target}", f"status:{target}.json", f"socket:{target}.socket"])
        values = {"model": str(memory / "validated.json"), "sysfs_root": str(memory / "sys"), "rate_hz": rate_hz}
        config = Path(f"{target}.config.json")
        config.write_text(json.dumps({**values, "publish": outputs, "state": {"path": f"{target}.state"}, **more}))
        return [*compiled, "run", "--config", str(config)]

    return {
        "bare loop": lambda rate_hz, target: [sys.executable, "-I", "-S", str(BARE), str(rate_hz), target, *zones],
        "recursion alone": daemon(compiled, "plain"),
        "4 fallbacks": daemon(compiled, "fallbacks"),
        "validated readings": daemon(compiled, "validated"),
        "the same, one file of sources": daemon(packed, "validated"),
        "the same, installed": daemon(installed, "validated"),
        "the same, learning from a reference": lambda rate_hz, target: with_all(
            rate_hz, target, publish=[f"file:{target}"], reference={"path": str(memory / "room")}
        ),
        "the same with status, socket and state": with_all,
        "all of these": lambda rate_hz, target: with_all(rate_hz, target, reference={"path": str(memory / "room")}),
    }


@pytest.fixture
def living_zones(model: Model, memory: Path) -> Iterator[None]:
    """The zones follow half an hour of a simulated phone."""
    trace = simulate("5", seed=1).trace
    rows = np.round(np.column_stack([trace.column(each.column) for each in model.main.inputs]) * 10).astype(int) * 100
    paths = [memory / f"sys/class/thermal/thermal_zone{index}/temp" for index in range(rows.shape[1])]
    descriptors = [os.open(path, os.O_WRONLY | os.O_CREAT) for path in paths]
    ended = threading.Event()

    def follow() -> None:
        for row in rows[1800:].tolist():
            for descriptor, value in zip(descriptors, row):
                os.pwrite(descriptor, f"{value}\n".ljust(8, "\n").encode(), 0)  # never seen empty
            if ended.wait(1.0):
                return

    writer = threading.Thread(target=follow)
    writer.start()
    yield
    ended.set()
    writer.join()
    for descriptor in descriptors:
        os.close(descriptor)


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


def _first_value_s(command: list[str], target: Path) -> float:
    """From the start of the process to the file that it publishes."""
    target.unlink(missing_ok=True)
    start_s = time.monotonic()
    with _running(command):
        wait_until(target.exists, "nothing is published")
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


@pytest.mark.benchmark(group="daemon")
@pytest.mark.parametrize("rate_hz", MEASURED_S)
def test_a_device_s_hour(rate_hz, subjects, living_zones, memory, benchmark, noted):
    def measured() -> tuple[list[list[float]], list[float]]:
        for left in memory.glob("out*.state"):  # of the rate before, whose zones had moved on: a jump of all sensors
            left.unlink()
        with contextlib.ExitStack() as stack:
            processes = []
            for index, command in enumerate(subjects.values()):
                processes.append(stack.enter_context(_running(command(rate_hz, str(memory / f"out{index}")))))
                time.sleep(1.237 / rate_hz)  # not all at the same moment
            time.sleep(SETTLED_S)
            return _ticks_s(processes, rate_hz, MEASURED_S[rate_hz]), [resident_kB(each.pid) for each in processes]

    ticks, held_kB = benchmark.pedantic(measured, rounds=1)
    hours_s = [sum(each) / MEASURED_S[rate_hz] * 3600 for each in ticks]
    for name, hour_s, each, kB in zip(subjects, hours_s, ticks, held_kB):
        p50, p99 = np.percentile(each, [50, 99]) * 1e6
        result = (
            f"{hour_s:.2f} CPU s an hour ({hour_s / hours_s[0]:.2f} x bare), tick p50 {p50:.0f} us, p99 {p99:.0f} us"
        )
        noted(f"{rate_hz:g} Hz, 4 zones to 1 file", name, MEASURED_S[rate_hz], f"{result}, VmRSS {kB / 1024:.1f} MB")
    for each in ticks:
        assert len(each) == pytest.approx(rate_hz * MEASURED_S[rate_hz], rel=0.1, abs=2)


@pytest.mark.benchmark(group="daemon")
@pytest.mark.parametrize(
    "name", ["bare loop", "validated readings", "the same, one file of sources", "the same, installed"]
)
def test_the_first_estimate(name, subjects, living_zones, memory, benchmark, noted):
    target = memory / "first"
    found = []
    benchmark.pedantic(
        lambda: found.append(_first_value_s(subjects[name](1.0, str(target)), target)), rounds=STARTS, iterations=1
    )
    noted("start to first value", name, float(np.median(found)), f"of {STARTS}, worst {max(found):.3f} s")


def _ticks_until(target: Path, end_s: float) -> int:
    """How often the file that is published has been replaced."""
    seen = set()
    while time.monotonic() < end_s:
        with contextlib.suppress(FileNotFoundError):
            seen.add(target.stat().st_mtime_ns)
        time.sleep(1 / COUNTED_HZ / 10)
    return len(seen)


def _system_calls(command: list[str], target: Path) -> float:
    """A tick's system calls, of all threads."""
    target.unlink(missing_ok=True)
    with _running(command) as process:
        wait_until(target.exists, "nothing is published", 60.0)
        summary = target.with_suffix(".strace")
        words = ["strace", "-f", "-c", "-U", "calls,name", "-o", str(summary), "-p", str(process.pid)]
        tracer = subprocess.Popen(words, stderr=subprocess.DEVNULL)
        ticks = _ticks_until(target, time.monotonic() + COUNTED_S)
        tracer.send_signal(signal.SIGINT)
        tracer.wait()
    return int(summary.read_text().split("-\n")[-1].split()[0]) / ticks


def _instructions(command: list[str], target: Path) -> float:
    """A tick's instructions outside the kernel, of all threads."""
    found = target.with_suffix(".callgrind")
    target.unlink(missing_ok=True)
    with _running(["valgrind", "--tool=callgrind", f"--callgrind-out-file={found}", *command]) as process:
        wait_until(target.exists, "nothing is published", 60.0)
        time.sleep(SETTLED_S)
        control = ["callgrind_control", "--zero", str(process.pid)]
        subprocess.run(control, check=True, capture_output=True)
        ticks = _ticks_until(target, time.monotonic() + COUNTED_S)
        control[1] = "--dump"
        subprocess.run(control, check=True, capture_output=True)
    return int(Path(f"{found}.1").read_text().partition("\ntotals: ")[2].split()[0]) / ticks


@pytest.mark.timeout(900)
@pytest.mark.benchmark(group="daemon")
@pytest.mark.parametrize(("count", "program"), [(_system_calls, "strace"), (_instructions, "valgrind")])
def test_what_a_tick_counts(count, program, subjects, living_zones, memory, benchmark, noted):
    if shutil.which(program) is None:
        pytest.skip(f"{program} is not installed")
    counted = ["bare loop", "recursion alone", "validated readings", "the same, learning from a reference"]
    counted += ["the same with status, socket and state", "all of these"]
    found = benchmark.pedantic(
        lambda: [count(subjects[name](COUNTED_HZ, str(memory / "counted")), memory / "counted") for name in counted],
        rounds=1,
    )
    for name, each in zip(counted, found):
        result = f"{each:.3g} a tick ({each / found[0]:.2f} x bare)"
        noted(f"{count.__name__[1:].replace('_', ' ')}, {COUNTED_HZ:g} Hz", name, COUNTED_S, result)
