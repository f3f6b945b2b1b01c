"""A daemon that runs for months must not grow: 400,000 replayed ticks, all outputs, sensors that come and go."""

import itertools
import json
import math
import os
import socket
import subprocess
import sys
import threading
import time

import pytest

from processes import resident_kB

TICKS, LOOK, SETTLED = 400_000, 20_000, 2
"""In all; ticks from one look to the next, and looks: by then everything has happened that ever happens."""

pytestmark = pytest.mark.slow


def read_all(path: str) -> None:
    """A reader of the socket that keeps up."""
    with socket.socket(socket.AF_UNIX) as reader:
        while reader.connect_ex(path) != 0:
            time.sleep(0.01)
        while reader.recv(65536):
            pass


def test_neither_memory_nor_descriptors_grow(make_model, saved, tmp_path, memory):
    """Every 400 samples one sensor is away for 50, and every 4,000 both, for longer than is bridged."""
    path = tmp_path / "trace.csv"
    with path.open("w") as stream:
        stream.write("time_s,usb_degC,battery_degC\n")
        for k in range(TICKS):
            away = [k % 800 in range(start, start + 50) or k % 4000 in range(3600, 3700) for start in (200, 600)]
            values = (30 + 5 * math.sin(k / 80), 25 + k % 37 / 10)
            cells = ("" if gone else f"{value:.2f}" for gone, value in zip(away, values))
            stream.write(f"{k},{','.join(cells)}\n")
    command = [sys.executable, "-m", "ambientd", "run", "--model", saved(make_model(fallbacks=True))]
    kinds = ("file", "file-in-place", "status", "socket")
    outputs = ["stdout", *(f"{kind}:{memory}/{kind}" for kind in kinds), f"prometheus:{memory}/a.prom"]
    command += ["--replay", path, "--speed", "0", *(word for output in outputs for word in ("--publish", output))]
    threading.Thread(target=read_all, args=(f"{memory}/socket",), daemon=True).start()
    found = []
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as process:
        for _ in range(TICKS // LOOK - 1):
            *_, line = itertools.islice(process.stdout, LOOK)
            found.append((resident_kB(process.pid), len(os.listdir(f"/proc/{process.pid}/fd"))))
        *_, line = process.stdout
    assert process.returncode == 0
    assert json.loads(line)["time_s"] == TICKS - 1
    print("VmRSS in KB and descriptors:", *found)
    sizes_KB, descriptors = zip(*found)
    assert max(sizes_KB[SETTLED:]) <= max(sizes_KB[:SETTLED])
    assert min(descriptors[SETTLED:]) <= min(descriptors[:SETTLED])  # one more is a file on its way
