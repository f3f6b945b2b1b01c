"""Work is many results by key, each of them the same wherever and whenever it is computed.

So it is done in parallel, kept as it comes in, and skipped where it was done before.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from types import TracebackType
from typing import Any, Protocol

from joblib import delayed
from threadpoolctl import threadpool_limits

from ambient_trainer.estimation.workers import results, workers
from ambient_trainer.selection.state import State

Progress = Callable[[str, int, int], None]
"""Told what is worked at, how many results of it are there, and how many are wanted."""


class Task(Protocol):
    """A pure function from keys to results that JSON can hold; it goes to the workers as it is."""

    @property
    def name(self) -> str:
        """Tells its results from those of other tasks."""

    def __call__(self, keys: Sequence[str]) -> list[Any]:
        """The result of each key."""


class Work:
    """Runs tasks in ``jobs`` processes; a context, whose end stops them."""

    def __init__(self, jobs: int, state: State, progress: Progress) -> None:
        self.state = state
        self.progress = progress
        self.computed = 0
        """How many results were not known before."""
        self._parallel = workers(jobs)

    def __enter__(self) -> Work:
        self._parallel.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._parallel.__exit__(kind, error, trace)

    def results(self, what: str, task: Task, keys: Sequence[str], at_once: int) -> Mapping[str, Any]:
        """The results of ``keys``, computed ``at_once`` by a process where they are not known yet."""
        known = self.state.results
        missing = [key for key in dict.fromkeys(keys) if f"{task.name} {key}" not in known]
        parts = [missing[first : first + at_once] for first in range(0, len(missing), at_once)]
        done = len(keys) - len(missing)
        self.progress(what, done, len(keys))
        if parts:
            # results come in the order of the parts, whoever is done first
            computed = results(self._parallel, (delayed(_limited)(task, part) for part in parts))
            for part, found in zip(parts, computed):
                self.state.add({f"{task.name} {key}": value for key, value in zip(part, found)})
                done += len(part)
                self.computed += len(part)
                self.progress(what, done, len(keys))
        return {key: known[f"{task.name} {key}"] for key in keys}


def _limited(task: Task, keys: Sequence[str]) -> list[Any]:
    with threadpool_limits(1):
        return task(keys)
