"""The benchmark: the circuit is trained once, then each case is diagnosed and scored, many at a time."""

import time
from collections.abc import Generator, Sequence
from dataclasses import dataclass

import numpy as np
from joblib import delayed

from ambient_model.trace import REFERENCE
from ambient_studies.discovery.cases import Case, simulated
from ambient_studies.discovery.figures import Outcome
from ambient_studies.discovery.score import score
from ambient_trainer.circuits import Circuit
from ambient_trainer.data import Trace
from ambient_trainer.diagnosis import KnownGood, diagnose_changed, learn_known_good
from ambient_trainer.estimation import results, workers
from ambient_trainer.simulator import Simulated, Truth, load_device

_AT_ONCE = 24
"""Runs that are simulated together."""


@dataclass(frozen=True)
class Bench:
    """A circuit, and what known-good runs say of it."""

    circuit: Circuit
    known: KnownGood
    baselines: tuple[str, ...]


@dataclass(frozen=True)
class Done:
    """A case, its outcome, a sentence a step, and the causes not distinguishable from the first step."""

    case: Case
    outcome: Outcome
    sentences: tuple[str, ...]
    rivals: tuple[str, ...]


def train(circuit: Circuit, baselines: Sequence[Trace]) -> Bench:
    """The bench that known-good runs give."""
    return Bench(circuit, learn_known_good(circuit, baselines), tuple(trace.path for trace in baselines))


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
    parts = (cases[first : first + _AT_ONCE] for first in range(0, len(cases), _AT_ONCE))
    runs = ((case, run) for part in parts for case, run in zip(part, simulated(part)))
    with workers(jobs) as parallel:
        yield from results(parallel, (delayed(diagnosed)(bench, case, run) for case, run in runs))


def diagnosed(bench: Bench, case: Case, run: Simulated) -> Done:
    """One case: only its trace is diagnosed; the truth is for the score."""
    started_s = time.perf_counter()
    found = diagnose_changed(bench.known, bench.circuit, [run.trace], bench.baselines)
    seconds = time.perf_counter() - started_s
    device = load_device(case.device)
    outcome = score(run.truths, size_in_noise(bench, run), found, bench.circuit, device, seconds)
    rivals = found.steps[0].indistinguishable_from if found.steps else ()
    return Done(case, outcome, tuple(step.sentence for step in found.steps), tuple(str(each) for each in rivals))


def size_in_noise(bench: Bench, run: Simulated) -> float:
    """The smallest effect's RMS in the sensor that feels it most, over what the trained circuit leaves there.

    A clock changes the reference alone: what counts is what the circuit, driven by it, then simulates otherwise.
    """
    return min((_size(bench, run, truth) for truth in run.truths), default=0.0)


def _size(bench: Bench, run: Simulated, truth: Truth) -> float:
    known = bench.known
    sensors = [output.name for output in known.model.circuit.outputs]
    if truth.worst != REFERENCE:
        return float(truth.size_degC or 0.0) / float(known.noise_degC[sensors.index(str(truth.worst)[: -len("_degC")])])
    if run.clean is None:
        return 0.0
    logged, clean = (known.simulated_degC(trace) for trace in (run.trace, run.clean))
    return float(np.max(np.sqrt(np.mean((logged - clean) ** 2, axis=1)) / known.noise_degC))
