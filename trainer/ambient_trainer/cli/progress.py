"""Progress bars on standard error, and a Ctrl-C that ends only the search."""

from __future__ import annotations

import contextlib
import functools
import math
import signal
import threading
from collections.abc import Callable, Iterator
from types import FrameType
from typing import TYPE_CHECKING, Any, TypeAlias

import click
from rich import progress
from rich.console import Console

import ambient_trainer as at

if TYPE_CHECKING:
    from ambient_trainer.estimation import Progress as SearchProgress  # scipy: --help should not wait for it

Show: TypeAlias = Callable[[str, int, int], None]
"""What is under way, how much of it is done, and of how much."""

_PATIENCE_S = 1.0
"""Work that is over sooner shows no bar; chosen, about the time that a user waits without wondering."""


@contextlib.contextmanager
def fit_progress(name: str, effort: at.Effort, searches: int, samples: int) -> Iterator[SearchProgress]:
    """A bar over the searches of a fit, mostly one a start, with the evaluations and the best RMSE so far.

    The first Ctrl-C cancels the search of ``effort``; where that had nothing to return yet, the command is aborted.
    """
    counted = progress.MofNCompleteColumn(), progress.TextColumn("searches")
    with _cancelled_by_interrupt(effort), _bar(0.0, *counted) as show_bar:
        show_bar(name, 0, searches)

        def show(done: int, evaluation: int, square: float) -> None:
            rmse = math.sqrt(square / max(samples, 1))
            show_bar(f"{name}, evaluation {evaluation}, best {rmse:.3f} degC", done, searches)

        yield show


@contextlib.contextmanager
def _bar(patience_s: float, *numbers: progress.ProgressColumn) -> Iterator[Show]:
    console = Console(stderr=True)
    described = progress.TextColumn("{task.description}", markup=False)
    columns = progress.SpinnerColumn(), described, progress.BarColumn(), *numbers, progress.TimeElapsedColumn()
    bars = progress.Progress(*columns, console=console, transient=True, disable=not console.is_terminal)
    with _remembered_interrupts() as caught, bars as bar:
        task = bar.add_task("", total=None, visible=False)
        shown = threading.Timer(patience_s, bar.update, (task,), {"visible": True})
        shown.start()

        def show(what: str, done: int, total: int) -> None:
            if caught:
                raise KeyboardInterrupt
            bar.update(task, description=what, completed=done, total=total)

        try:
            yield show
        finally:
            shown.cancel()


@contextlib.contextmanager
def handled(handle: Callable[[int, FrameType | None], None], *signals: int) -> Iterator[dict[int, Any]]:
    """In the block ``handle`` gets these signals, where this thread is the one that gets any; gives those before it."""
    main = threading.current_thread() is threading.main_thread()
    before = {each: signal.signal(each, handle) for each in signals if main}
    try:
        yield before
    finally:
        for each, handler in before.items():
            signal.signal(each, handler)


@contextlib.contextmanager
def _remembered_interrupts() -> Iterator[list[int]]:
    """Ctrl-C raises as ever, and is kept: where a callback of a library raises it, it goes no further."""
    caught: list[int] = []

    def handle(number: int, frame: FrameType | None) -> None:
        caught.append(number)
        signal.default_int_handler(number, frame)

    usual = signal.getsignal(signal.SIGINT) is signal.default_int_handler
    with handled(handle, *[signal.SIGINT] * usual):
        yield caught


staged_progress = functools.partial(_bar, _PATIENCE_S)
"""A bar over the stages of a work."""
counted_progress = functools.partial(_bar, _PATIENCE_S, progress.MofNCompleteColumn())
"""A bar with the two numbers beside it."""


@contextlib.contextmanager
def _cancelled_by_interrupt(effort: at.Effort) -> Iterator[None]:
    from ambient_trainer.estimation.search import Cancelled  # numpy: --help should not wait for it

    def handle(number: int, frame: FrameType | None) -> None:
        effort.budget.cancel()
        signal.signal(number, before[number])  # a second one ends the command as usual

    try:
        with handled(handle, signal.SIGINT) as before:
            yield
    except Cancelled:
        raise click.Abort from None
