"""Results by key, computed in parallel and kept in a file as they come in: a search goes on where it stopped.

The file is an SQLite database. It belongs to the data and options of one search, which holds it locked while it runs.
"""

from __future__ import annotations

import contextlib
import json
import os
import sqlite3
from collections.abc import Callable, Hashable, Mapping, Sequence
from typing import Any

from joblib import delayed
from threadpoolctl import threadpool_limits

from ambient_model.faults import Fault, Refused, refuse
from ambient_trainer.estimation.workers import results, workers

_HEADER = {"format": "ambient-search-state", "version": 2}
Task = Callable[[Sequence[Any]], Sequence[Any]]
_ANEW = "remove it to start anew, or name another --state"


class ResumablePool(contextlib.ExitStack):
    """Worker processes and the results that are known; a context, whose end stops the processes and closes the file.

    Results depend on ``identity`` and are kept in the state file ``path``, if any. ``progress`` gets what is computed,
    how many results are there, and how many are wanted. Raises :class:`Refused` for a file of another search or in use.
    """

    def __init__(
        self,
        jobs: int,
        path: str | None = None,
        identity: Mapping[str, Any] | None = None,
        progress: Callable[[str, int, int], None] = lambda *_: None,
    ) -> None:
        super().__init__()
        self._progress, self._parallel = progress, workers(jobs)
        self._database, self.known = _opened(path, {**_HEADER, **(identity or {})})
        self.callback(self._database.close)

    def __enter__(self) -> ResumablePool:
        self.enter_context(self._parallel)
        return self

    def results(
        self, what: str, task: Task, keys: Sequence[Hashable], at_once: int = 1, name: str = ""
    ) -> dict[Any, Any]:
        """The results by key, computed ``at_once`` by a process where they are not known yet.

        ``task`` is a pure function of keys whose results JSON can hold, ``name`` or ``what`` its own among tasks.
        """
        names = {key: f"{name or what} {key!r}" for key in keys}
        missing = [key for key, name in names.items() if name not in self.known]
        parts = [missing[first : first + at_once] for first in range(0, len(missing), at_once)]
        done = len(names) - len(missing)
        self._progress(what, done, len(names))
        # results come in the order of the parts, whichever is done first
        computed = results(self._parallel, (delayed(_one_thread)(task, part) for part in parts)) if parts else ()
        for part, values in zip(parts, computed):
            new = {names[key]: value for key, value in zip(part, values)}
            with self._database:
                _insert(self._database, "results", new)
            self.known.update(new)
            done += len(new)
            self._progress(what, done, len(names))
        return {key: self.known[name] for key, name in names.items()}


def _one_thread(task: Task, keys: Sequence[Any]) -> Sequence[Any]:
    with threadpool_limits(1):
        return task(keys)


def _insert(database: sqlite3.Connection, table: str, values: Mapping[str, Any]) -> None:
    rows = [(name, json.dumps(value)) for name, value in values.items()]
    database.executemany(f"INSERT INTO {table} VALUES (?, ?)", rows)


def _opened(path: str | None, header: Mapping[str, Any]) -> tuple[sqlite3.Connection, dict[str, Any]]:
    """The database at ``path`` and its results."""
    exists = path is not None and os.path.exists(path)
    database = sqlite3.connect(path or ":memory:", timeout=0)
    try:
        # whatever a killed process left half-written is rolled back; a crash of the machine may cost the file
        for statement in ("PRAGMA synchronous = OFF", "PRAGMA locking_mode = EXCLUSIVE", "BEGIN EXCLUSIVE"):
            database.execute(statement)
        if not exists:
            for table in ("header", "results"):
                database.execute(f"CREATE TABLE {table} (name TEXT, value TEXT)")
            _insert(database, "header", header)
        elif database.execute("PRAGMA integrity_check").fetchone() != ("ok",):
            raise sqlite3.DatabaseError("damaged")
        kept, known = (
            {name: json.loads(value) for name, value in database.execute(f"SELECT name, value FROM {table}")}
            for table in ("header", "results")
        )
        database.commit()
        faults = [
            Fault(name, f"the state was made with {kept.get(name)!r:.200}, this search has {value!r:.200}", _ANEW)
            for name, value in json.loads(json.dumps(header)).items()
            if kept.get(name) != value
        ]
        if faults:
            raise Refused(str(path), faults)
    except BaseException as error:
        database.close()
        if isinstance(error, sqlite3.OperationalError) and "locked" in str(error):
            raise refuse(str(path), "", "another search is using it", "wait, or name another --state") from None
        if isinstance(error, sqlite3.Error | ValueError | TypeError):
            raise refuse(str(path), "", "is not the state of a search, or is damaged", _ANEW) from None
        raise
    return database, known
