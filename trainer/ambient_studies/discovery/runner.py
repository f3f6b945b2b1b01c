"""The benchmark runs: the circuit is trained once, then each case is diagnosed and scored, many at a time.

Workers are forked: what was trained is the model's own functions, which no pipe carries.
"""

from __future__ import annotations

import multiprocessing
import signal
import time
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from dataclasses import dataclass

import numpy as np
from threadpoolctl import threadpool_limits

from ambient_model.trace import REFERENCE
from ambient_studies.discovery.cases import Case, simulated
from ambient_studies.discovery.score import Scored, score
from ambient_trainer.circuits.circuit import Circuit
from ambient_trainer.data.trace import Trace
from ambient_trainer.diagnosis.diagnose import diagnose_trained
from ambient_trainer.diagnosis.forward import forward
from ambient_trainer.diagnosis.record import diagnosis_period_s
from ambient_trainer.diagnosis.result import Diagnosis
from ambient_trainer.diagnosis.selection import known_good_model
from ambient_trainer.diagnosis.training import TrainedCircuit, records_of, train_on_baselines
from ambient_trainer.estimation.search import Progress
from ambient_trainer.simulator.simulate import Simulated
from ambient_trainer.simulator.truth import Truth

_AT_ONCE = 24
"""Runs that are simulated together."""
_TICK_S = 0.5


@dataclass(frozen=True)
class Bench:
    """A circuit, what known-good runs trained of it, and the period of its records."""

    circuit: Circuit
    trained: TrainedCircuit
    period_s: float
    baselines: tuple[str, ...]


@dataclass(frozen=True)
class Done:
    """A case, its score, and what was said."""

    case: Case
    scored: Scored
    said: tuple[str, ...]
    """A sentence a step."""
    rivals: tuple[str, ...]
    """What the first step cannot be told from."""


def teach(circuit: Circuit, baselines: Sequence[Trace], progress: Progress | None = None) -> Bench:
    """The bench that known-good runs give."""
    period_s = diagnosis_period_s(baselines)
    with threadpool_limits(1):
        trained = train_on_baselines(forward(circuit), baselines, period_s, known_good_model, progress)
    return Bench(circuit, trained, period_s, tuple(trace.path for trace in baselines))


def run(
    bench: Bench, cases: Sequence[Case], jobs: int, waiting: Callable[[], object] = lambda: None
) -> Generator[Done, None, None]:
    """Each case as it is done, by so many processes; closing the iterator stops them. ``waiting`` is called often."""
    if jobs == 1:
        for case, run in _runs(cases):
            yield diagnosed(bench, case, run)
            waiting()
        return
    others = set(multiprocessing.active_children())
    pool = ProcessPoolExecutor(jobs, multiprocessing.get_context("fork"), _begin, (bench,))
    try:
        yield from _as_done((pool.submit(_diagnosed, case, run) for case, run in _runs(cases)), waiting)
    except BaseException:
        # what still runs is of no use to whoever stopped waiting
        for worker in set(multiprocessing.active_children()) - others:
            worker.terminate()
        raise
    finally:
        pool.shutdown(cancel_futures=True)


def diagnosed(bench: Bench, case: Case, run: Simulated) -> Done:
    """One case: its trace alone is diagnosed; the truth is only what that is scored by."""
    started_s = time.perf_counter()
    with threadpool_limits(1):
        said = diagnose_trained(bench.trained, bench.circuit, [run.trace], bench.baselines, bench.period_s)
    seconds = time.perf_counter() - started_s
    return _done(bench, case, run, said, seconds)


def size_in_noise(bench: Bench, run: Simulated) -> float:
    """The smallest effect's RMS in the sensor that feels it most, over what the trained circuit leaves there.

    A clock changes the reference alone: what counts is what the circuit, driven by it, then simulates otherwise.
    """
    return min((_size(bench, run, truth) for truth in run.truths), default=0.0)


def _done(bench: Bench, case: Case, run: Simulated, said: Diagnosis, seconds: float) -> Done:
    scored = score(run.truths, size_in_noise(bench, run), said, bench.circuit, seconds)
    rivals = said.steps[0].indistinguishable_from if said.steps else ()
    return Done(case, scored, tuple(step.sentence for step in said.steps), tuple(str(each) for each in rivals))


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


_bench: list[Bench] = []
"""A worker's own."""


def _begin(bench: Bench) -> None:
    # whoever interrupts means the benchmark, which then ends its workers
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _bench[:] = [bench]


def _diagnosed(case: Case, run: Simulated) -> Done:
    return diagnosed(_bench[0], case, run)


def _as_done(submitted: Iterable[Future[Done]], waiting: Callable[[], object]) -> Iterator[Done]:
    left: set[Future[Done]] = set()
    for one in submitted:
        done, left = wait({one, *left}, 0)
        yield from (each.result() for each in done)
        waiting()
    while left:
        done, left = wait(left, _TICK_S, FIRST_COMPLETED)
        yield from (each.result() for each in done)
        waiting()
