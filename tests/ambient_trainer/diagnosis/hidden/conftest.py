"""Runs with something hidden in them: of the simulated phone, and of a box whose physics stand here.

A number makes a run and what is hidden in it; the diagnosis gets traces, a circuit and known-good runs, nothing else.
"""

import os
import pickle
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from threadpoolctl import threadpool_limits

from ambient_studies.discovery.cases import CAUSES, Case, baselines, simulated
from ambient_studies.discovery.figures import Outcome
from ambient_studies.discovery.runner import Bench, score, size_in_noise
from ambient_trainer.circuits.circuit import Circuit
from ambient_trainer.circuits.schema import load_circuit
from ambient_trainer.diagnosis.diagnose import diagnose_changed, learn_known_good
from ambient_trainer.diagnosis.result import Diagnosis
from ambient_trainer.simulator import SIGNALS, Simulated, draw_hidden, load_device, load_scenario

PERIOD_S = 20.0
"""Of the phone's records: half as many samples as a diagnosis takes by itself, for half the time."""
SCALE, BASELINE_SEED = 2.5, 1
BOX = Path(__file__).parents[3] / "data" / "circuits" / "box.yaml"


@pytest.fixture(scope="session")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Bench:
    """The phone's circuit, trained by three known-good runs; by one worker for those that come to it later."""
    own = tmp_path_factory.getbasetemp()
    kept = (own.parent if "PYTEST_XDIST_WORKER" in os.environ else own) / "bench"
    if not kept.exists():
        circuit, runs = load_circuit("phone"), baselines(BASELINE_SEED)
        known = learn_known_good(circuit, runs, period_s=PERIOD_S)
        (own / "made").write_bytes(pickle.dumps(Bench(circuit, known, tuple(trace.path for trace in runs))))
        (own / "made").replace(kept)
    return pickle.loads(kept.read_bytes())


@dataclass(frozen=True)
class Diagnosed:
    """What was hidden in a run, its diagnosis, and how that compares."""

    run: Simulated
    found: Diagnosis
    outcome: Outcome


@pytest.fixture(scope="session")
def diagnosed(bench: Bench) -> Callable[..., Diagnosed]:
    """Diagnoses a run in which effects of some causes are hidden, all else drawn from ``seed``."""

    def diagnose(seed: int, *causes: str, **given: object) -> Diagnosed:
        random = np.random.default_rng([seed, *(CAUSES.index(cause) for cause in causes)])
        hidden = tuple(draw_hidden(random, cause, load_scenario("5").duration_s, SCALE, **given) for cause in causes)
        idle = [name for name in SIGNALS if name not in {effect.signal for effect in hidden}]
        decoys = sorted(str(name) for name in random.choice(idle, 2, replace=False))
        case = Case(seed, int(random.integers(2**31)), hidden, tuple(decoys))
        run = simulated([case])[0]
        with threadpool_limits(1):
            found = diagnose_changed(bench.known, bench.circuit, [run.trace], bench.baselines)
        scored = score(run.truths, size_in_noise(bench, run), found, bench.circuit, load_device(), 0.0)
        return Diagnosed(run, found, scored)

    return diagnose


@pytest.fixture(scope="session")
def box() -> Circuit:
    """Three nodes in a row, as bare as a first guess: :func:`boxed` says what a real box may have besides."""
    return load_circuit(str(BOX))
