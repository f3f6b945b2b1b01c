"""Results of a run's tasks, one file each, kept for --resume and removed when the run has ended well."""

import contextlib
import datetime
import json
import os
import pickle
import shutil
from collections.abc import Callable, Iterator, Sequence
from typing import Any

from ambient_model.faults import refuse
from ambient_trainer.fleet.engine import Engine, Tasks

Progress = Callable[[str, int, int], None]
"""Called with what is under way, how much of it is done, and of how much."""
_FOLDER = ".parts"


class Stage(Sequence[bytes]):
    """The results of the tasks of a stage as they were sent, each in a file."""

    def __init__(self, folder: str, name: str, count: int) -> None:
        self.paths = [os.path.join(folder, f"{name}-{number:06d}.pickle") for number in range(count)]

    def __len__(self) -> int:
        return len(self.paths)

    def __getitem__(self, number: Any) -> Any:
        with open(self.paths[number], "rb") as stream:
            return stream.read()

    def results(self) -> Iterator[list[Any]]:
        """The results of each task, in their order."""
        return map(pickle.loads, self)


class TaskResults:
    """The results of tasks in a folder, computed where they are not there yet."""

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

    def stage(self, name: str, what: str, job: Tasks) -> Stage:
        """The results of a job, whose missing tasks are done; progress calls it ``what``."""
        stage, count = Stage(self._folder, name, len(job.items)), len(job.items)
        # a power failure may leave the name of a file without its content
        missing = [n for n, path in enumerate(stage.paths) if not os.path.exists(path) or not os.path.getsize(path)]
        done = count - len(missing)
        self.progress(what, done, count)
        for number, found in self._engine.run(job, missing):
            write_whole(stage.paths[number], found)
            done += 1
            self.progress(what, done, count)
        return stage

    def remove(self) -> None:
        """Forget everything: the run has ended."""
        shutil.rmtree(self._folder, ignore_errors=True)


def write_whole(path: str, content: bytes) -> None:
    """Write a file, whole or not at all; what a power failure loses is computed anew."""
    temporary = f"{path}.{os.getpid()}.part"
    with open(temporary, "wb") as stream:
        stream.write(content)
    os.replace(temporary, path)
