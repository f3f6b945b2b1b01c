"""A bar while a fit works, on the terminal's standard error; nothing where there is no terminal."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

from ambient_trainer.identify import search


@contextlib.contextmanager
def fit_progress(name: str, searches: int, samples: int) -> Iterator[search.Progress]:
    """A bar over the searches of a fit, mostly one a start, with the evaluations and the best RMSE so far."""
    columns = (
        SpinnerColumn(),
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("searches"),
        TimeElapsedColumn(),
    )
    console = Console(stderr=True)
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task(name, total=searches)

        def show(done: int, evaluation: int, square: float) -> None:
            rmse = float(np.sqrt(square / max(samples, 1)))
            bar.update(task, completed=done, description=f"{name}, evaluation {evaluation}, best {rmse:.3f} degC")

        yield show


@contextlib.contextmanager
def staged_progress() -> Iterator[Callable[[str, int, int], None]]:
    """A bar that is told what is under way, how much of it is done, and of how much."""
    console = Console(stderr=True)
    columns = (SpinnerColumn(), TextColumn("{task.description}", markup=False), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task("", total=None)
        yield lambda what, done, total: bar.update(task, description=what, completed=done, total=total)
