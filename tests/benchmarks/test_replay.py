"""How long the daemon takes for a day at 1 Hz, as a process, start-up and files included."""

import subprocess
import sys

import numpy as np
import pytest

from ambient_model.codec import save_model
from ambient_model.trace import write_trace

DAY = 86_400


@pytest.mark.benchmark(group="daemon")
@pytest.mark.parametrize("fallbacks", [0, 4])
def test_a_day_at_1_hz(fallbacks, model, benchmark, noted, tmp_path):
    paths = [str(tmp_path / name) for name in ("model.json", "day.csv", "out.csv")]
    save_model(paths[0], model if fallbacks else model._replace(fallbacks={}))
    u = np.round(25 + 10 * np.sin(np.arange(DAY) / 5000) + np.random.default_rng(0).normal(size=(4, DAY)), 2)
    columns = [each.column for each in model.main.inputs]
    write_trace(paths[1], columns, ((float(k), row) for k, row in enumerate(u.T.tolist())))
    command = [sys.executable, "-m", "ambientd", "replay", paths[0], paths[1], "-o", paths[2]]
    benchmark.pedantic(subprocess.run, args=(command,), kwargs={"check": True, "capture_output": True}, rounds=3)
    wall_s = benchmark.stats.stats.min
    with open(paths[2], encoding="utf-8") as stream:
        assert sum(1 for _ in stream) == DAY + 1
    task = f"a day at 1 Hz, 4 inputs, 3 states, {fallbacks or 'no'} fallbacks"
    noted(task, "ambientd replay", wall_s, f"{wall_s / DAY * 1e6:.0f} us a sample")
