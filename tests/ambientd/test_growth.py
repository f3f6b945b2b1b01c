"""A daemon that runs for months must not grow: 200,000 replayed ticks, with sensors that come and go."""

import itertools
import json
import math
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

TICKS = 200_000
SETTLED = 50_000
"""By then everything has happened that ever happens."""
MOST_KB = 128
"""Of resident memory: pages that are touched anew, where 1 byte a tick would be 150 KB."""

pytestmark = pytest.mark.slow


@pytest.fixture
def long_trace(tmp_path: Path) -> Path:
    """Every thousand samples one sensor is away for 50, and every ten thousand both, for longer than is bridged."""
    path = tmp_path / "trace.csv"
    with path.open("w") as stream:
        stream.write("time_s,usb_degC,battery_degC\n")
        for k in range(TICKS):
            away = [k % 2000 in range(start, start + 50) or k % 10_000 in range(9000, 9100) for start in (500, 1500)]
            values = (30 + 5 * math.sin(k / 80), 25 + k % 37 / 10)
            cells = ("" if gone else f"{value:.2f}" for gone, value in zip(away, values))
            stream.write(f"{k},{','.join(cells)}\n")
    return path


def rss_KB(pid: int) -> int:
    return int(Path(f"/proc/{pid}/status").read_text().partition("VmRSS:")[2].split()[0])


@pytest.fixture
def memory(tmp_path: Path) -> Iterator[Path]:
    """A folder in memory, as /run is, where there is one: a disk takes an hour for a million renames."""
    folder = Path(f"/dev/shm/ambientd-growth-{os.getpid()}") if os.access("/dev/shm", os.W_OK) else tmp_path / "run"
    folder.mkdir()
    yield folder
    shutil.rmtree(folder)


def test_the_process_does_not_grow(fallback_model_file, long_trace, memory):
    command = [sys.executable, "-m", "ambientd", "run", "--model", fallback_model_file, "--replay", str(long_trace)]
    command += ["--speed", "0", "--publish", "stdout", "--publish", f"file:{memory}/ambient"]
    sizes_KB = []
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as process:
        lines = process.stdout
        for _ in range(TICKS // 10_000):
            *_, line = itertools.islice(lines, 10_000)
            sizes_KB.append(rss_KB(process.pid) if len(sizes_KB) < TICKS // 10_000 - 1 else sizes_KB[-1])
        assert lines.read() == ""
    assert process.returncode == 0
    assert json.loads(line)["time_s"] == TICKS - 1
    settled = SETTLED // 10_000
    assert max(sizes_KB[settled:]) - max(sizes_KB[:settled]) <= MOST_KB
