"""Ctrl-C cancels a search, which then returns its best so far; a second one ends the command as usual."""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Iterator
from types import FrameType
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from ambient_trainer.estimation.budget import CancelToken


@contextlib.contextmanager
def interruptible(token: CancelToken) -> Iterator[None]:
    """Cancel ``token`` on the first Ctrl-C while the block runs.

    Parameters
    ----------
    token : CancelToken
        What the work in the block asks between evaluations.

    Raises
    ------
    click.Abort
        Where the work was cancelled before it had anything to return.
    """
    from ambient_trainer.estimation.budget import Cancelled  # numpy: --help should not wait for it

    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.getsignal(signal.SIGINT)

    def handle(number: int, frame: FrameType | None) -> None:
        token.cancel()
        signal.signal(signal.SIGINT, before)

    signal.signal(signal.SIGINT, handle)
    try:
        yield
    except Cancelled:
        raise click.Abort from None
    finally:
        signal.signal(signal.SIGINT, before)
