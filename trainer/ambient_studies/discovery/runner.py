"""The benchmark: the circuit is trained once, then each case is diagnosed and scored, many at a time."""

from __future__ import annotations

import time
from collections.abc import Generator, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from joblib import delayed
from threadpoolctl import threadpool_limits

from ambient_model.trace import REFERENCE
from ambient_studies.discovery.cases import Case, simulated
from ambient_studies.discovery.score import Scored, score
from ambient_trainer.circuits import Circuit
from ambient_trainer.data import Trace
from ambient_trainer.diagnosis import (
    TrainedCircuit,
    diagnose_trained,
    diagnosis_period_s,
    forward,
    known_good_model,
    records_of,
    train_on_baselines,
)
from ambient_trainer.estimation import Progress, results, workers
from ambient_trainer.simulator import Simulated, Truth

_AT_ONCE = 24
"""Runs that are simulated together."""


@dataclass(frozen=True)
class Bench:
    """A circuit, trained on known-good runs, and the period of its records."""

    circuit: Circuit
    trained: TrainedCircuit
    period_s: float
    baselines: tuple[str, ...]


@dataclass(frozen=True)
class Done:
    """A case, its score, a sentence a step, and the causes not distinguishable from the first step."""

    case: Case
    scored: Scored
    sentences: tuple[str, ...]
    rivals: tuple[str, ...]


def train(circuit: Circuit, baselines: Sequence[Trace], progress: Progress | None = None) -> Bench:
    """The bench that known-good runs give."""
    period_s = diagnosis_period_s(baselines)
    with threadpool_limits(1):
        trained = train_on_baselines(forward(circuit), baselines, period_s, known_good_model, progress)
    return Bench(circuit, trained, period_s, tuple(trace.path for trace in baselines))


def run(bench: Bench, cases: Sequence[Case], jobs: int) -> Generator[Done, None, None]:
    """Diagnose and score each case, by so many processes.

    Parameters
    ----------
    bench : Bench
        What :func:`train` gave.
    cases : sequence of Case
        In the order of the results.
    jobs : int
        Processes; closing the iterator ends them.

    Yields
    ------
    Done
        A case as soon as it and those before it are done.
    """
    with workers(jobs) as parallel:
        yield from results(parallel, (delayed(diagnosed)(bench, case, run) for case, run in _runs(cases)))


def diagnosed(bench: Bench, case: Case, run: Simulated) -> Done:
    """One case: only its trace is diagnosed; the truth is for the score."""
    started_s = time.perf_counter()
    with threadpool_limits(1):
        found = diagnose_trained(bench.trained, bench.circuit, [run.trace], bench.baselines, bench.period_s)
    seconds = time.perf_counter() - started_s
    scored = score(run.truths, size_in_noise(bench, run), found, bench.circuit, seconds)
    rivals = found.steps[0].indistinguishable_from if found.steps else ()
    return Done(case, scored, tuple(step.sentence for step in found.steps), tuple(str(each) for each in rivals))


def size_in_noise(bench: Bench, run: Simulated) -> float:
    """The smallest effect's RMS in the sensor that feels it most, over what the trained circuit leaves there.

    A clock changes the reference alone: what counts is what the circuit, driven by it, then simulates otherwise.
    """
    return min((_size(bench, run, truth) for truth in run.truths), default=0.0)


def _size(bench: Bench, run: Simulated, truth: Truth) -> float:
    plant, deviation = bench.trained.model.plant, bench.trained.noise.deviation_degC
    if truth.worst != REFERENCE:
        return float(truth.size_degC or 0.0) / float(deviation[plant.sensors.index(str(truth.worst)[: -len("_degC")])])
    if run.clean is None:
        return 0.0
    logged, clean = (
        plant.forced(records_of(plant.circuit, trace, bench.period_s)[0].inputs) for trace in (run.trace, run.clean)
    )
    felt = np.sqrt(np.mean((logged - clean)[plant.reads] ** 2, axis=1))
    return float(np.max(felt / deviation))


def _runs(cases: Sequence[Case]) -> Iterator[tuple[Case, Simulated]]:
    for first in range(0, len(cases), _AT_ONCE):
        some = cases[first : first + _AT_ONCE]
        yield from zip(some, simulated(some))
