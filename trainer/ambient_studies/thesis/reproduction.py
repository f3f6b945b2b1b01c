"""The thesis's evaluation on a simulated phone: simulate, train on scenario 5, evaluate on all others, compare.

No two runs share a seed, so none has another's weather or noise.
"""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from ambient_studies import Progress
from ambient_studies.thesis.errata import Erratum
from ambient_studies.thesis.methods import Method, observer_methods, thesis_methods
from ambient_studies.thesis.published import Results
from ambient_studies.thesis.rows import Evaluated, Verdict, evaluate, verdict
from ambient_trainer.data import Trace
from ambient_trainer.simulator import simulate_many

TRAINING = "5"
IDLE = "1"
EVALUATED = ("1", "2.1", "2.2", "2.3", "2.4", "2.5", "3", "4")
"""Every scenario but the training's, in the thesis's order."""


@dataclass(frozen=True)
class Runs:
    """Simulated runs: what methods are trained on, and what they are evaluated on by the scenario's name."""

    training: Trace
    idle: Trace
    evaluated: dict[str, Trace]


@dataclass(frozen=True)
class Reproduction:
    """Everything that tables, page and JSON are made of."""

    seed: int
    runs: Runs
    methods: Sequence[Method]
    evaluated: Evaluated
    verdict: Verdict


def reproduce(
    seed: int, train: Callable[[Runs, Progress], Sequence[Method]], published: Results, progress: Progress
) -> Reproduction:
    """Run the thesis's protocol on a simulated phone: train methods on its runs, evaluate them, and judge.

    Each run draws its own weather and noise from ``seed``; ``train`` is :func:`all_methods`, or trains fewer.
    """
    runs = simulated_runs(seed, progress)
    methods = train(runs, progress)
    evaluated = evaluate(methods, runs.evaluated, published, progress)
    return Reproduction(seed, runs, methods, evaluated, verdict(evaluated.rows))


def simulated_runs(seed: int, progress: Progress) -> Runs:
    """Simulate every run, each with a seed of its own that follows from ``seed``."""
    names = (TRAINING, IDLE, *EVALUATED)
    first = seed * len(names)
    runs = simulate_many(
        [(name, first + index) for index, name in enumerate(names)],
        progress=lambda done, total: progress("simulating the scenarios", done, total),
    )
    training, idle, *evaluated = (run.trace for run in runs)
    return Runs(training, idle, dict(zip(EVALUATED, evaluated)))


def all_methods(runs: Runs, progress: Progress) -> list[Method]:
    """The thesis's ten models in all their variants, the four related methods and our observers, trained."""
    from ambient_studies.thesis.related import related_methods  # scikit-learn takes a second to import

    thesis = thesis_methods(runs.training, progress)
    progress("fitting the related methods", 0, 1)
    return [*thesis, *related_methods(runs.training, runs.idle), *observer_methods(runs.training, progress)]


def as_json(reproduction: Reproduction, errata: Sequence[Erratum]) -> dict[str, Any]:
    """The content of ``reproduce --json``."""
    return {
        "simulated": True,
        "seed": reproduction.seed,
        **asdict(reproduction.verdict),
        "rows": [asdict(row) for row in reproduction.evaluated.rows],
        "errata": [asdict(each) for each in errata],
        "methods": [
            {"model": each.name, "variant": each.variant, "about": each.about} for each in reproduction.methods
        ],
    }
