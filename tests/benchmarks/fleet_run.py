"""One run over a fleet in a process of its own: DATASET ENGINE WORKERS FOLDER; what it took, as JSON."""

import json
import os
import sys
import time
from pathlib import Path

from ambient_trainer.estimators.base import Effort
from ambient_trainer.fleet.dataset import Source
from ambient_trainer.fleet.engine import Engine, engine_of
from ambient_trainer.fleet.fit_units import Question
from ambient_trainer.fleet.run import fit_fleet


class Timed(Engine):
    """Another engine, or this process; ``start_s`` is how long it takes to start, ``task_s`` the time of this process's
    tasks alone, without what keeps, reads and writes their results."""

    start_s, task_s = 0.0, 0.0

    def __init__(self, engine: Engine | None) -> None:
        self._engine = engine

    def __enter__(self) -> Engine:
        since = time.perf_counter()
        if self._engine:
            self._engine.__enter__()
        self.start_s = time.perf_counter() - since
        return self

    def __exit__(self, *given: object) -> None:
        if self._engine:
            self._engine.__exit__(*given)

    def run(self, job, numbers):
        def timed(*args):
            since = time.perf_counter()
            found = list(job.task(*args))
            self.task_s += time.perf_counter() - since
            return found

        return self._engine.run(job, numbers) if self._engine else super().run(job._replace(task=timed), numbers)


def main() -> None:
    path, name, workers, folder = sys.argv[1:]
    engine = Timed(None if name == "serial" else engine_of(name, int(workers)))
    # what is written stays: for minutes after thousands of files were removed, ext4 takes ten times as long to make one
    begun = time.perf_counter()
    fit_fleet(Question(path, "free-2", Source("unit"), effort=Effort(starts=4)), folder, engine)
    found = {
        "start_s": engine.start_s,
        "run_s": time.perf_counter() - begun - engine.start_s,
        "task_s": engine.task_s,
        "peak_MB": int(Path("/proc/self/status").read_text().partition("VmHWM:")[2].split()[0]) / 1024,
        "load": os.getloadavg()[0],
    }
    print(json.dumps(found))


if __name__ == "__main__":
    main()
