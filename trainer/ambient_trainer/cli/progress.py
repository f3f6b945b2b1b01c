"""A bar while a command works, on the terminal's standard error; nothing where there is no terminal."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    SpinnerColumn,
    TextColumn,
    TimeElapsedColumn,
)

if TYPE_CHECKING:
    from ambient_trainer.estimation import search  # scipy: --help should not wait for it


@contextlib.contextmanager
def fit_progress(name: str, searches: int, samples: int) -> Iterator[search.Progress]:
    """A bar over the searches of a fit, mostly one a start, with the evaluations and the best RMSE so far."""
    with _bar(MofNCompleteColumn(), TextColumn("searches")) as told:
        told(name, 0, searches)

        def show(done: int, evaluation: int, square: float) -> None:
            rmse = math.sqrt(square / max(samples, 1))
            told(f"{name}, evaluation {evaluation}, best {rmse:.3f} degC", done, searches)

        yield show


def staged_progress() -> contextlib.AbstractContextManager[Callable[[str, int, int], None]]:
    """A bar that is told what is under way, how much of it is done, and of how much."""
    return _bar()


def counted_progress() -> contextlib.AbstractContextManager[Callable[[str, int, int], None]]:
    """The same, with the two numbers beside it."""
    return _bar(MofNCompleteColumn())


@contextlib.contextmanager
def _bar(*numbers: ProgressColumn) -> Iterator[Callable[[str, int, int], None]]:
    console = Console(stderr=True)
    columns = (
        SpinnerColumn(),
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        *numbers,
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task("", total=None)
        yield lambda what, done, total: bar.update(task, description=what, completed=done, total=total)
