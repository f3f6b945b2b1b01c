"""Worker processes leave Ctrl-C to whoever started them, who then ends them.

One that is interrupted while it starts would print a traceback of its own: it inherits what is blocked.
"""

import contextlib
import os
import signal
import threading
import warnings
from collections.abc import Callable, Iterable, Iterator
from multiprocessing.resource_tracker import ensure_running
from typing import Any

from joblib import Parallel

# tasks are cut short by Ctrl-C, and a worker that has grown is replaced by another
warnings.filterwarnings("ignore", r"\d+ tasks which|A worker stopped", UserWarning, r"joblib\.")
# nor does the process that cleans up after them, which knows this one's filters by its environment alone
os.environ.setdefault("PYTHONWARNINGS", "ignore::UserWarning:joblib.externals.loky.backend.resource_tracker")


def workers(jobs: int) -> Parallel:
    """A context in which :func:`results` are computed by ``jobs`` processes, or by this one."""
    options = {"initializer": signal.signal, "initargs": (signal.SIGINT, signal.SIG_IGN)} if jobs > 1 else {}
    return Parallel(n_jobs=jobs, return_as="generator", batch_size=1, **options)


def results(parallel: Parallel, tasks: Iterable[tuple[Callable[..., Any], Any, Any]]) -> Iterator[Any]:
    """What the delayed ``tasks`` return, in their order, each as soon as it and those before are done."""
    with uninterrupted():
        return iter(parallel(tasks))


@contextlib.contextmanager
def uninterrupted() -> Iterator[None]:
    """Processes that start in the block never see Ctrl-C; to this one it comes when the block is done."""
    if threading.current_thread() is not threading.main_thread():
        yield  # Ctrl-C comes to the main thread alone
        return
    caught: list[int] = []
    ensure_running()  # its start unblocks Ctrl-C
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    before = signal.signal(signal.SIGINT, lambda number, frame: caught.append(number))
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
        signal.signal(signal.SIGINT, before)
        if caught:
            signal.raise_signal(signal.SIGINT)
