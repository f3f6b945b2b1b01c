"""Where the tasks run: in this process, on a local Dask cluster, or on any Dask scheduler.

Tasks are pure functions of what they are sent, numbered from 0. A worker that dies is replaced and its tasks are done
again; a lost connection to the scheduler is made anew, and what was under way is sent again. A task whose worker dies
every time is taken apart, so that it costs one unit and not a chunk. Results come as they are done: whoever needs an
order asks for it by number.
"""

from __future__ import annotations

import contextlib
import signal
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from typing import Any, TypeVar

from ambient_model.faults import refuse

_Result = TypeVar("_Result")

LOCAL, SERIAL = "local", "serial"
_AHEAD = 3
"""Tasks a worker that wait for it: enough that none is idle, few enough that the driver holds no more."""
_RETRIES = 3
_DEATHS = 6
"""How often the worker of one task may die on the local cluster before the task is taken apart."""
_SETTINGS = {
    "distributed.scheduler.allowed-failures": _DEATHS,
    "distributed.worker.daemon": True,
    # Dask has the allocator give back all above 64 KiB: each array of a task would be mapped and zeroed anew
    "distributed.nanny.pre-spawn-environ.MALLOC_TRIM_THRESHOLD_": 1 << 27,
    "distributed.nanny.pre-spawn-environ.MALLOC_MMAP_THRESHOLD_": 1 << 25,
    "distributed.admin.log-format": "%(message)s",
    # the scheduler, which is in this process, would keep the last thousand messages, and with them the tasks' data
    "distributed.admin.low-level-log-length": 10,
}
"""Of the local cluster, as long as it is there: workers that come later have them, too."""
_CONNECTIONS = 5
_PATIENCE_S = 60.0


class Engine(ABC):
    """What runs tasks; a context, whose end stops what it started."""

    workers = 1
    address: str | None = None
    """Of Dask's dashboard."""

    def __enter__(self) -> Engine:
        return self

    def __exit__(self, *_: object) -> None:
        return None

    @abstractmethod
    def run(
        self,
        task: Callable[..., Sequence[_Result]],
        numbers: Sequence[int],
        arguments: Callable[[int], tuple[Sequence[Any], tuple[Any, ...]]],
        lost: Callable[[Any], _Result],
    ) -> Iterator[tuple[int, list[_Result]]]:
        """The number and the results of each task as it is done.

        ``arguments`` gives a task's items and what else it needs; it is asked when the task is about to be sent.
        ``lost`` is the result of an item whose worker dies whenever it is tried.
        """


class Serial(Engine):
    """This process, one task after the other."""

    def run(
        self,
        task: Callable[..., Sequence[_Result]],
        numbers: Sequence[int],
        arguments: Callable[[int], tuple[Sequence[Any], tuple[Any, ...]]],
        lost: Callable[[Any], _Result],
    ) -> Iterator[tuple[int, list[_Result]]]:
        """The tasks in their order."""
        for number in numbers:
            items, rest = arguments(number)
            yield number, list(task(items, *rest))


class Dask(Engine):
    """A Dask cluster: a local one of ``workers`` processes, or that of the scheduler at an address."""

    def __init__(self, engine: str, workers: int) -> None:
        self._engine = engine
        self._wanted = workers
        self._cluster: Any = None
        self._client: Any = None
        self._settings: contextlib.AbstractContextManager[Any] = contextlib.nullcontext()

    def __enter__(self) -> Dask:
        try:
            import dask
            import distributed
        except ImportError as error:
            problem = f"Dask is not installed ({error.name})"
            raise refuse("--engine", "", problem, "pip install 'ambientd[trainer,fleet]', or --engine serial") from None
        if self._engine == LOCAL:
            self._settings = dask.config.set(_SETTINGS)
            with _without_interrupts():
                self._cluster = distributed.LocalCluster(
                    n_workers=self._wanted, threads_per_worker=1, dashboard_address="127.0.0.1:0", silence_logs=50
                )
        try:
            self._connect()
        except BaseException:
            self.__exit__()
            raise
        self.address = self._client.dashboard_link
        return self

    def __exit__(self, *_: object) -> None:
        for each in (self._client, self._cluster):
            if each is not None:
                with contextlib.suppress(Exception):
                    each.close(timeout=5)
        self._client = self._cluster = None
        self._settings.__exit__(None, None, None)

    def _connect(self) -> None:
        import distributed

        if self._client is not None:
            with contextlib.suppress(Exception):
                self._client.close(timeout=1)
        place = self._cluster if self._cluster is not None else self._engine
        limit_s = time.monotonic() + _PATIENCE_S
        while True:
            try:
                self._client = distributed.Client(place, timeout=10, set_as_default=False)
                break
            except (OSError, TimeoutError, ValueError) as error:
                if isinstance(error, ValueError) or time.monotonic() > limit_s:
                    problem = f"no Dask scheduler answers ({str(error).partition(chr(10))[0]:.200})"
                    raise refuse(self._engine, "", problem, "start one: dask scheduler, dask worker") from None
                time.sleep(1.0)
        self.workers = max(1, sum(self._client.nthreads().values()))

    def run(
        self,
        task: Callable[..., Sequence[_Result]],
        numbers: Sequence[int],
        arguments: Callable[[int], tuple[Sequence[Any], tuple[Any, ...]]],
        lost: Callable[[Any], _Result],
    ) -> Iterator[tuple[int, list[_Result]]]:
        """The tasks as they are done, a few ahead of the workers."""
        left = list(numbers)
        for attempt in range(_CONNECTIONS):
            try:
                for number, found in self._connected(task, left, arguments, lost):
                    left.remove(number)
                    yield number, found
                return
            except Exception as error:
                if not _connection_lost(error) or attempt == _CONNECTIONS - 1:
                    raise
                self._connect()

    def _connected(
        self,
        task: Callable[..., Sequence[_Result]],
        numbers: Sequence[int],
        arguments: Callable[[int], tuple[Sequence[Any], tuple[Any, ...]]],
        lost: Callable[[Any], _Result],
    ) -> Iterator[tuple[int, list[_Result]]]:
        from distributed import KilledWorker, as_completed

        waiting = iter(tuple(numbers))
        underway: dict[Any, int] = {}
        done = as_completed(loop=self._client.loop)

        def send() -> None:
            number = next(waiting, None)
            if number is not None:
                items, rest = arguments(number)
                future = self._client.submit(task, items, *rest, pure=False, retries=_RETRIES)
                underway[future] = number
                done.add(future)

        for _ in range(_AHEAD * self.workers):
            send()
        while underway:
            future = next(done)
            number = underway.pop(future)
            try:
                found = list(future.result())
            except KilledWorker:
                found = self._alone(task, *arguments(number), lost)
            future.release()
            send()
            yield number, found

    def _alone(
        self,
        task: Callable[..., Sequence[_Result]],
        items: Sequence[Any],
        rest: tuple[Any, ...],
        lost: Callable[[Any], _Result],
    ) -> list[_Result]:
        """Each item in a task of its own."""
        from distributed import KilledWorker

        found: list[_Result] = []
        for item in items:
            try:
                found += self._client.submit(task, [item], *rest, pure=False, retries=_RETRIES).result()
            except KilledWorker:
                found.append(lost(item))
        return found


def engine_of(name: str, workers: int) -> Engine:
    """The engine called so: ``local``, ``serial``, or a scheduler's address; raises :class:`Refused` for others."""
    if name == SERIAL:
        return Serial()
    if name != LOCAL and "://" not in name:
        hint = f"write {LOCAL}, {SERIAL}, or the address of a scheduler such as tcp://127.0.0.1:8786"
        raise refuse("--engine", "", f"{name!r} is no engine", hint)
    return Dask(name, workers)


@contextlib.contextmanager
def _without_interrupts() -> Iterator[None]:
    """Processes that are started meanwhile ignore Ctrl-C: the driver ends them."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _connection_lost(error: Exception) -> bool:
    from concurrent.futures import CancelledError

    from distributed.client import FutureCancelledError
    from distributed.comm import CommClosedError

    return isinstance(error, CommClosedError | FutureCancelledError | CancelledError | ConnectionError | TimeoutError)
