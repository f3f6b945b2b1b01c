"""Killed at any moment, it leaves whole files behind, and a status that is no newer than they are."""

import json
import random
import subprocess
import sys
import time
from pathlib import Path

import pytest

from ambient_model.conformance import conformance_of
from ambient_model.model import Discrete, Estimator, Input, Model

from .observer import number_in

KILLS = 24
ROWS = 3000


@pytest.fixture
def observed(tmp_path, spawn):
    """The folder to publish in, someone who looks at it all the time, and what that one has to say in the end."""
    folder = tmp_path / "out"
    folder.mkdir()
    observer = spawn([sys.executable, Path(__file__).with_name("observer.py"), folder])

    def end():
        (folder / "stop").touch()
        said, _ = observer.communicate(timeout=60)
        (folder / "stop").unlink()
        return json.loads(said)

    return folder, end


def test_killed_at_random_moments_it_never_misleads(tmp_path, saved, observed, until):
    """Half of them while it starts or publishes, half surely while it publishes, a thousand times a second."""
    folder, end = observed
    # its only sensor is its estimate
    sensor, bands = Input("row", "degC", "row", -1000.0, 1e6), dict.fromkeys((50, 90, 98), (-1.0, 1.0))
    main = Estimator((sensor,), (), (Discrete(1.0, (), (), ((),), ((1.0,),)),), 0.0, (), bands)
    model = saved(Model("echo", "2024-05-01", "ambient_degC", main, {}, {}, conformance_of(main, ((0.0,), (1.0,)))))
    moments = random.Random(20240501)
    trace = tmp_path / "trace.csv"
    # the status is named first: the order in which they are named must not be the order of what they say
    publish = [f"status:{folder}/status", f"file:{folder}/temp", f"file-in-place:{folder}/same"]
    command = [sys.executable, "-m", "ambientd", "run", "--model", model, "--replay", str(trace)]
    command += ["--rate", "1000", *(word for each in publish for word in ("--publish", each))]

    def said():
        status = folder / "status"
        return round(json.loads(status.read_bytes())["ambient_degC"] * 1000) if status.exists() else 0

    row = 9_000  # values of four digits, and soon of five and six
    for kill in range(KILLS + 1):
        trace.write_text("time_s,row_degC\n" + "".join(f"{k},{k / 1000}\n" for k in range(row, row + ROWS)))
        daemon = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
        if kill in (0, KILLS) or kill % 2:
            until(lambda row=row: said() >= row, "it publishes nothing", seconds=60)
            time.sleep(moments.uniform(0.0, 0.03))
        else:
            time.sleep(moments.uniform(0.05, 0.25))
        if kill == KILLS:
            break
        daemon.kill()
        daemon.communicate()
        at = said()
        for name in ("temp", "same"):
            assert at <= number_in((folder / name).read_bytes()) <= max(at + 1, row)
        row += ROWS
    seen = end()
    assert seen["faults"] == []
    assert seen["looks"] > KILLS
    daemon.terminate()
    assert daemon.wait(30) == 0
    daemon.stderr.close()
    assert list(folder.iterdir()) == []
