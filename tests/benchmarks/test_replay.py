"""How long the daemon takes for a day at 1 Hz, as a process, start-up and files included."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from ambient_model.codec import save_model
from ambient_model.trace import write_trace
from ambient_trainer.circuits.schema import load_circuit
from ambient_trainer.export.model_file import model_of
from ambient_trainer.identify.fit import Effort, fit_circuit
from ambient_trainer.simulation.phone import simulate

DAY = 86_400


@pytest.mark.benchmark(group="daemon")
def test_a_day_at_1_hz(benchmark, noted, tmp_path):
    fit = fit_circuit(load_circuit("model2_ss_free_cd"), [simulate("5", seed=1, period_s=5.0)], Effort(starts=1))
    paths = [str(tmp_path / name) for name in ("model.json", "day.csv", "out.csv")]
    save_model(paths[0], model_of(fit, [], {}))
    u = np.round(25 + 10 * np.sin(np.arange(DAY) / 5000) + np.random.default_rng(0).normal(size=(4, DAY)), 2)
    write_trace(paths[1], fit.inputs, ((float(k), row) for k, row in enumerate(u.T.tolist())))
    command = [sys.executable, "-m", "ambientd", "replay", paths[0], paths[1], "-o", paths[2]]
    benchmark.pedantic(subprocess.run, args=(command,), kwargs={"check": True, "capture_output": True}, rounds=3)
    wall_s = benchmark.stats.stats.min
    with open(paths[2], encoding="utf-8") as stream:
        assert sum(1 for _ in stream) == DAY + 1
    noted("a day at 1 Hz, 4 inputs, 3 states", "ambientd replay", wall_s, f"{wall_s / DAY * 1e6:.0f} us a sample")
