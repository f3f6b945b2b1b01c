"""What is trained on and what is evaluated on never share a seed: no two runs have the same weather or noise."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from ambient_trainer.data.trace import Trace
from ambient_trainer.simulator.phone import simulate_many

Progress = Callable[[str, int, int], None]
"""Told what is being done, how much of it is done and how much there is."""

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


def simulated_runs(seed: int, progress: Progress) -> Runs:
    """Every run from seeds of its own, which follow from ``seed``."""
    names = (TRAINING, IDLE, *EVALUATED)
    first = seed * len(names)
    traces = simulate_many(
        [(name, first + index) for index, name in enumerate(names)],
        progress=lambda done, total: progress("simulating the scenarios", done, total),
    )
    return Runs(traces[0], traces[1], dict(zip(EVALUATED, traces[2:])))
