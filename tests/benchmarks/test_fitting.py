"""How long a fit takes: this project's search beside the obvious way with the same data and the same start."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.signal import cont2discrete, dlsim

from ambient_trainer.circuits.assemble import assemble
from ambient_trainer.circuits.circuit import Circuit
from ambient_trainer.circuits.schema import load_circuit
from ambient_trainer.identify.discretise import zero_order_hold
from ambient_trainer.identify.fit import Effort, fit_circuit
from ambient_trainer.identify.free_start import FreelyStartingCircuit
from ambient_trainer.identify.search import search
from ambient_trainer.simulation.phone import simulate
from ambient_trainer.traces.grid import Segment

THREE_NODES = Path(__file__).parents[1] / "data" / "circuits" / "three_nodes.yaml"
SAMPLES = 25_000
NOISE_DEGC = 0.05
START_DEGC = np.array([30.0, 25.0, 22.0])
TASK = "3 nodes, 25,000 samples, 9 R and C + 3 starts"


class Problem(NamedTuple):
    """What both methods are given, and the truth."""

    circuit: Circuit
    """With its parameters up to 3x off."""
    truth: dict[str, float]
    inputs: np.ndarray
    outputs: np.ndarray


@pytest.fixture(scope="module")
def problem() -> Problem:
    random = np.random.default_rng(1)
    circuit = load_circuit(str(THREE_NODES))
    truth = {each.name: each.initial for each in circuit.parameters}
    power = np.repeat(random.choice([0.0, 1.0, 2.0, 5.0], SAMPLES // 250), 250)
    ambient = 20 + 5 * np.sin(np.arange(SAMPLES) / 4000) + np.repeat(random.normal(size=SAMPLES // 2500), 2500)
    u = np.vstack([ambient, power])
    d = zero_order_hold(assemble(circuit, truth).value, 1.0)
    _, y, _ = dlsim((d.A, d.B, d.C, d.D, 1.0), u.T, x0=START_DEGC)
    y = y.T + random.normal(size=(3, SAMPLES)) * NOISE_DEGC
    off = np.exp(random.uniform(-np.log(3), np.log(3), len(circuit.parameters)))
    start = [
        replace(each, initial=float(each.initial * factor)) if each.free else each
        for each, factor in zip(circuit.parameters, off)
    ]
    return Problem(replace(circuit, parameters=tuple(start)), truth, u, y)


def _searched(problem: Problem):
    """The parameters by name and the RMSE in degC, by this project's search."""
    structure = FreelyStartingCircuit(problem.circuit, [Segment(1.0, problem.inputs, problem.outputs)])
    best = search(structure, 1, 0).best
    return structure.values(best.theta, best.beta), np.sqrt(best.sum_of_squares / problem.outputs.size)


def _obvious(problem: Problem):
    """The same by ``least_squares`` over ``dlsim``: logarithms of R and C, and the initial temperatures."""
    free = [each for each in problem.circuit.parameters if each.free]
    held = {each.name: each.initial for each in problem.circuit.parameters if not each.free}
    names = [each.name for each in free]

    def values(unknowns):
        return {**held, **dict(zip(names, np.exp(unknowns[: len(names)])))}

    def residual(unknowns):
        s = assemble(problem.circuit, values(unknowns)).value
        discrete = cont2discrete((s.A, s.B, s.C, s.D), 1.0, "zoh")
        _, y, _ = dlsim(discrete, problem.inputs.T, x0=unknowns[len(names) :])
        return (y.T - problem.outputs).ravel()

    start = [*(np.log(each.initial) for each in free), *problem.outputs[:, 0]]
    found = least_squares(residual, start)
    return values(found.x), np.sqrt(np.mean(found.fun**2))


@pytest.mark.benchmark(group=TASK)
@pytest.mark.parametrize(
    ("method", "name", "rounds"),
    [(_searched, "this project's search", 5), (_obvious, "least_squares over dlsim", 1)],
    ids=["ours", "obvious"],
)
def test_a_forward_circuit(method, name, rounds, problem, benchmark, noted):
    found, rmse_degC = benchmark.pedantic(method, args=(problem,), rounds=rounds, iterations=1)
    free = [each.name for each in problem.circuit.parameters if each.free]
    worst = max(abs(found[each] / problem.truth[each] - 1) for each in free)
    noted(TASK, name, benchmark.stats.stats.min, f"RMSE {rmse_degC:.5f} degC, worst parameter {worst:.2%} off")
    assert rmse_degC == pytest.approx(NOISE_DEGC, rel=0.01)
    assert worst < 0.02


@pytest.mark.benchmark(group="thesis")
def test_one_start_of_the_best_circuit_of_the_thesis(benchmark, noted):
    trace = simulate("5", seed=1)
    circuit = load_circuit("model2_ss_free_cd")
    fit = benchmark.pedantic(fit_circuit, args=(circuit, [trace], Effort(starts=1)), rounds=3, iterations=1)
    task = f"model2_ss_free_cd, scenario 5, {fit.samples:,} samples, 9 R and C + 7 weights"
    result = f"RMSE {fit.rmse_degC:.3f} degC in {fit.evaluations} evaluations"
    noted(task, "one start", benchmark.stats.stats.min, result)
    assert np.isfinite(fit.rmse_degC)
