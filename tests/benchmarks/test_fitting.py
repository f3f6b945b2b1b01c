"""How long one start of a fit takes that the thesis did; ``test_rivals.py`` holds a fit against other programs."""

from __future__ import annotations

import numpy as np
import pytest

from ambient_trainer.circuits.schema import load_circuit
from ambient_trainer.estimators.base import Effort
from ambient_trainer.estimators.circuit import fit_circuit
from ambient_trainer.simulator.simulate import simulate


@pytest.mark.benchmark(group="thesis")
def test_one_start_of_the_best_circuit_of_the_thesis(benchmark, noted):
    trace = simulate("5", seed=1).trace
    circuit = load_circuit("model2_ss_free_cd")
    fit = benchmark.pedantic(fit_circuit, args=(circuit, [trace], Effort(starts=1)), rounds=3, iterations=1)
    task = f"model2_ss_free_cd, scenario 5, {fit.samples:,} samples, 9 R and C + 7 weights"
    result = f"RMSE {fit.rmse_degC:.3f} degC in {fit.evaluations} evaluations"
    noted(task, "one start", benchmark.stats.stats.min, result)
    assert np.isfinite(fit.rmse_degC)
