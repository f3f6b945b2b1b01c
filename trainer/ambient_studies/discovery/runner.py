"""The benchmark: the circuit is trained once, then each case is diagnosed and scored, many at a time.

What counts as found: cause, location and signal by name. Of one effect the first step has to name it, of two both have
to stand among the steps, and where nothing is hidden there may be no step.
"""

import math
import time
from collections.abc import Generator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from joblib import delayed

from ambient_model.trace import REFERENCE
from ambient_studies.discovery.cases import Case, simulated
from ambient_studies.discovery.figures import Outcome
from ambient_trainer.circuits import Circuit
from ambient_trainer.data import Trace
from ambient_trainer.diagnosis import Cause, Diagnosis, KnownGood, Step, diagnose_changed, learn_known_good
from ambient_trainer.estimation import results, workers
from ambient_trainer.simulator import Device, Simulated, Truth, load_device

_AT_ONCE = 24
"""Runs that are simulated together."""
ONSET_S = 120.0
MAGNITUDE_FRAC = 0.25
_SENSOR = "sensor_"
_CALLED = {"battery": "cell", "back": "case", "frame": "case"}
"""Simulated nodes that circuits call by another name."""


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
    """Diagnose and score each case, by so many processes: each comes as soon as it and those before it are done.

    Closing the iterator ends the processes.
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


def score(
    truths: Sequence[Truth],
    size_in_noise: float,
    diagnosis: Diagnosis,
    circuit: Circuit,
    device: Device,
    seconds: float,
) -> Outcome:
    """What a diagnosis by ``circuit`` found of what was hidden in ``device``."""
    true = tuple(_cause(truth, circuit, device) for truth in truths)
    found = tuple(_by_column(step.cause) for step in diagnosis.steps)
    named = [cause in found for cause in true]
    correct = all(named) and (bool(true) or not found)
    if len(true) == 1:
        correct = found[:1] == true
    onset_s = size = onset_right = magnitude_right = None
    if truths and named[0]:
        step = diagnosis.steps[found.index(true[0])]
        onset_s = onset_error_s(truths[0], step, float(diagnosis.time_s[0]))
        onset_right = None if onset_s is None else abs(onset_s) <= ONSET_S
        size = magnitude_error_frac(truths[0], step)
        low, high = step.magnitude.ci95 if step.magnitude else (math.nan, math.nan)
        magnitude_right = None if size is None else abs(size) <= MAGNITUDE_FRAC or low <= truths[0].magnitude <= high
    sure = tuple(step.confidence for step in diagnosis.steps)
    gain = diagnosis.steps[0].gain.ci95_degC if diagnosis.steps else None
    if gain is not None and not all(math.isfinite(end) for end in gain):
        gain = None  # of a simulation that ran away
    errors = size, onset_s, gain
    return Outcome(true, size_in_noise, found, correct, *errors, seconds, sure, onset_right, magnitude_right)


def onset_error_s(truth: Truth, step: Step, first_s: float) -> float | None:
    """Estimated less true, in s; None where a signal sets it, or neither has one. ``first_s`` is the trace's first."""
    if step.onset_s is None and (truth.onset_s is None or step.cause.signal is not None):
        return None
    found_s = first_s if step.onset_s is None else step.onset_s
    return found_s - (first_s if truth.onset_s is None else truth.onset_s)


def magnitude_error_frac(truth: Truth, step: Step) -> float | None:
    """Estimate less true, over the true one; None where they are not in the same unit, or it is no number."""
    if step.magnitude is None or step.magnitude.unit != truth.unit or not truth.magnitude:
        return None
    error = (step.magnitude.value - truth.magnitude) / abs(truth.magnitude)
    return error if math.isfinite(error) else None


def place_in(circuit: Circuit, simulated: str, device: Device) -> str:
    """The node of ``circuit`` that stands for a simulated one; the simulated name where none does."""
    read = {node.name: node.sensor for node in circuit.states}
    for name in (_CALLED.get(simulated), simulated):
        if name in read:
            return str(name)
    sensor = device.sensor_of(simulated)
    return next((name for name, own in read.items() if own is not None and own == sensor), simulated)


def _cause(truth: Truth, circuit: Circuit, device: Device) -> Cause:
    """The truth by the circuit's names, the ends of a path in the circuit's order."""
    if truth.location is None or truth.cause.startswith(_SENSOR):
        return Cause(truth.cause, truth.location, truth.signal)
    order = [node.name for node in circuit.states]
    places = [place_in(circuit, part, device) for part in truth.location.split("-")]
    places.sort(key=lambda place: order.index(place) if place in order else len(order))
    return Cause(truth.cause, "-".join(places), truth.signal)


def _by_column(cause: Cause) -> Cause:
    """With the logged column alone where the driver is a power of it: a truth names the column."""
    column, _, power = (cause.signal or "").partition("^")
    return replace(cause, signal=column) if power.isdigit() else cause
