"""Execution of tasks in this process, on a local Dask cluster, or on any Dask scheduler.

Tasks are pure functions of what they are sent, numbered from 0. A worker that dies is replaced and its tasks are done
again; a lost connection to the scheduler is made anew, and what was under way is sent again. A task whose worker dies
every time is taken apart, so that it costs one unit and not a chunk. Results come as they are done: whoever needs an
order asks for it by number.
"""

from __future__ import annotations

import contextlib
import itertools
import pickle
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

from ambient_model.faults import refuse
from ambient_trainer.estimation.workers import uninterrupted

LOCAL, SERIAL = "local", "serial"
_AHEAD = 3
"""Tasks a worker that wait for it: enough that none is idle, few enough that the driver holds no more."""
_RETRIES = 3
_DEATHS = 6
"""How often the worker of one task may die on the local cluster before the task is taken apart."""
_SETTINGS = {
    "distributed.scheduler.allowed-failures": _DEATHS,
    "distributed.worker.daemon": True,
    # what the tasks need is imported while the cluster starts, by all workers at once
    "distributed.worker.preload": ["ambient_trainer.fleet.fit_units"],
    # Dask has the allocator give back all above 64 KiB: each array of a task would be mapped and zeroed anew
    "distributed.nanny.pre-spawn-environ.MALLOC_TRIM_THRESHOLD_": 1 << 27,
    "distributed.nanny.pre-spawn-environ.MALLOC_MMAP_THRESHOLD_": 1 << 25,
    # Dask looks at what a worker is at a hundred times a second, which takes a tenth of it
    "distributed.worker.profile.interval": "1s",
    "distributed.admin.log-format": "%(message)s",
    # the scheduler, which is in this process, would keep the last thousand messages, and with them the tasks' data
    "distributed.admin.low-level-log-length": 10,
}
"""Of the local cluster, as long as it is there: workers that come later have them, too."""
_CONNECTIONS = 5
_PATIENCE_S = 60.0


class Tasks(NamedTuple):
    """Numbered tasks of one kind: ``task(items[number], *rest)`` gives a result an item.

    An entry of ``items`` is read when its task is about to be sent, and may be what another task gave, packed; ``lost``
    is the result of an item whose worker dies whenever it is tried.
    """

    task: Callable[..., Sequence[Any]]
    items: Sequence[Sequence[Any] | bytes]
    rest: tuple[Any, ...]
    lost: Callable[[Any], Any]


def packed(task: Callable[..., Sequence[Any]], items: Sequence[Any] | bytes, *rest: Any) -> bytes:
    """The results of a task as they are kept and sent: only who works on them unpacks them."""
    return pickle.dumps(list(task(unpacked(items), *rest)), protocol=5)


def unpacked(items: Sequence[Any] | bytes) -> Sequence[Any]:
    """Items as a task works on them."""
    found: Sequence[Any] = pickle.loads(items) if isinstance(items, bytes) else items
    return found


class Engine(contextlib.ExitStack):
    """Runs tasks in this process, one after the other; a context, whose end stops what it started."""

    workers = 1
    address: str | None = None
    """Of Dask's dashboard."""

    def run(self, job: Tasks, numbers: Sequence[int]) -> Iterator[tuple[int, bytes]]:
        """The number and the packed results of each task as it is done."""
        for number in numbers:
            yield number, packed(job.task, job.items[number], *job.rest)


class Dask(Engine):
    """A Dask cluster: a local one of ``workers`` processes, or that of the scheduler at an address."""

    def __init__(self, engine: str, workers: int) -> None:
        super().__init__()
        self._engine, self._wanted = engine, workers
        self._cluster: Any = None
        self._client: Any = None

    def __enter__(self) -> Dask:
        try:
            import dask
            import distributed
        except ImportError as error:
            problem = f"Dask is not installed ({error.name})"
            raise refuse("--engine", "", problem, "pip install 'ambientd[trainer,fleet]', or --engine serial") from None
        with contextlib.ExitStack() as stack:
            if self._engine == LOCAL:
                stack.enter_context(dask.config.set(_SETTINGS))
                with uninterrupted():
                    self._cluster = distributed.LocalCluster(
                        n_workers=self._wanted, threads_per_worker=1, dashboard_address="127.0.0.1:0", silence_logs=50
                    )
                stack.callback(_close, self._cluster, 5)
            stack.callback(lambda: _close(self._client, 5))
            self._connect()
            self.enter_context(stack.pop_all())
        self.address = self._client.dashboard_link
        return self

    def _connect(self) -> None:
        import distributed

        _close(self._client, 1)
        limit_s = time.monotonic() + _PATIENCE_S
        while True:
            try:
                self._client = distributed.Client(self._cluster or self._engine, timeout=10, set_as_default=False)
                break
            except (OSError, TimeoutError, ValueError) as error:
                if isinstance(error, ValueError) or time.monotonic() > limit_s:
                    problem = f"no Dask scheduler answers ({str(error).partition(chr(10))[0]:.200})"
                    raise refuse(self._engine, "", problem, "start one: dask scheduler, dask worker") from None
                time.sleep(1.0)
        self.workers = max(1, sum(self._client.nthreads().values()))

    def run(self, job: Tasks, numbers: Sequence[int]) -> Iterator[tuple[int, bytes]]:
        """The tasks as they are done, a few ahead of the workers."""
        from concurrent.futures import CancelledError

        from distributed.comm import CommClosedError

        left = list(numbers)
        for attempt in range(_CONNECTIONS):
            try:
                for number, found in self._connected(job, tuple(left)):
                    left.remove(number)
                    yield number, found
                return
            except (CommClosedError, CancelledError, ConnectionError, TimeoutError):
                if attempt == _CONNECTIONS - 1:
                    raise
                self._connect()

    def _connected(self, job: Tasks, numbers: Sequence[int]) -> Iterator[tuple[int, bytes]]:
        from distributed import KilledWorker, as_completed

        underway: dict[Any, int] = {}
        done = as_completed(loop=self._client.loop)

        def send(number: int) -> None:
            future = self._submitted(job, job.items[number])
            underway[future] = number
            done.add(future)

        ahead = _AHEAD * self.workers
        waiting = iter(numbers[ahead:])
        for number in numbers[:ahead]:
            send(number)
        while underway:
            future = next(done)
            number = underway.pop(future)
            try:
                found: bytes = future.result()
            except KilledWorker:
                found = packed(lambda items: [self._alone(job, item) for item in items], job.items[number])
            future.release()
            for following in itertools.islice(waiting, 1):
                send(following)
            yield number, found

    def _submitted(self, job: Tasks, items: Sequence[Any] | bytes) -> Any:
        return self._client.submit(packed, job.task, items, *job.rest, pure=False, retries=_RETRIES)

    def _alone(self, job: Tasks, item: Any) -> Any:
        """The result of an item in a task of its own."""
        from distributed import KilledWorker

        try:
            return unpacked(self._submitted(job, [item]).result())[0]
        except KilledWorker:
            return job.lost(item)


def engine_of(name: str, workers: int) -> Engine:
    """The engine called so: ``local``, ``serial``, or a scheduler's address; raises :class:`Refused` for others."""
    if name == SERIAL:
        return Engine()
    if name != LOCAL and "://" not in name:
        hint = f"write {LOCAL}, {SERIAL}, or the address of a scheduler such as tcp://127.0.0.1:8786"
        raise refuse("--engine", "", f"{name!r} is no engine", hint)
    return Dask(name, workers)


def _close(each: Any, timeout_s: float) -> None:
    """Close a client or a cluster, where there is one and as far as it answers."""
    if each is not None:
        with contextlib.suppress(Exception):
            each.close(timeout=timeout_s)
