"""What a run has done, a file a task; it belongs to one question, and is gone when the run has ended well."""

import contextlib
import datetime
import json
import os
import pickle
import shutil
from collections.abc import Callable, Iterator
from typing import Any

from ambient_model.faults import refuse
from ambient_trainer.fleet.engine import Engine, Job

Progress = Callable[[str, int, int], None]
"""Called with what is under way, how much of it is done, and of how much."""
_FOLDER = ".parts"


class Parts:
    """The results of tasks and stages in a folder, computed where they are not there yet."""

    def __init__(self, folder: str, identity: str, resume: bool, engine: Engine, progress: Progress) -> None:
        self._engine, self.progress = engine, progress
        self._folder = os.path.join(folder, _FOLDER)
        header = os.path.join(self._folder, "run.json")
        before: dict[str, str] = {}
        with contextlib.suppress(OSError, ValueError), open(header, encoding="utf-8") as stream:
            before = json.load(stream)
        if resume and before and before.get("identity") != identity:
            problem = "what lies there was begun with other units or options"
            raise refuse(folder, "--resume", problem, "leave --resume out to begin anew, or name another folder")
        if not (resume and before):
            shutil.rmtree(self._folder, ignore_errors=True)
            now = datetime.datetime.now(datetime.timezone.utc).isoformat(timespec="seconds")
            before = {"identity": identity, "created": now}
            os.makedirs(self._folder)
            write_whole(header, json.dumps(before).encode())
        self.created = before["created"]

    def kept(self, stage: str, compute: Callable[[], Any]) -> Any:
        """What was kept of a stage, computed where it was not."""
        path = self._path(stage)
        if not os.path.exists(path):
            write_whole(path, pickle.dumps(compute(), protocol=5))
        return _loaded(path)

    def fill(self, stage: str, what: str, count: int, job: Job) -> None:
        """Do the tasks of a stage that are not there; progress calls it ``what``."""
        missing = [number for number in range(count) if not os.path.exists(self._path(stage, number))]
        done = count - len(missing)
        self.progress(what, done, count)
        for number, found in self._engine.run(job, missing):
            write_whole(self._path(stage, number), found)
            done += 1
            self.progress(what, done, count)

    def packed(self, stage: str, number: int) -> bytes:
        """The results of a task as they were sent."""
        with open(self._path(stage, number), "rb") as stream:
            return stream.read()

    def load(self, stage: str, number: int) -> list[Any]:
        """The results of a task."""
        return list(_loaded(self._path(stage, number)))

    def each(self, stage: str, count: int) -> Iterator[Any]:
        """The results of all tasks of a stage, in their order."""
        for number in range(count):
            yield from self.load(stage, number)

    def _path(self, stage: str, number: int | None = None) -> str:
        return os.path.join(self._folder, f"{stage}.pickle" if number is None else f"{stage}-{number:06d}.pickle")

    def remove(self) -> None:
        """Forget everything: the run has ended."""
        shutil.rmtree(self._folder, ignore_errors=True)


def _loaded(path: str) -> Any:
    with open(path, "rb") as stream:
        return pickle.load(stream)


def write_whole(path: str, content: bytes) -> None:
    """Write a file, whole or not at all; what a power failure loses is computed anew."""
    temporary = f"{path}.{os.getpid()}.part"
    with open(temporary, "wb") as stream:
        stream.write(content)
    os.replace(temporary, path)
