"""Workers die, connections are cut, the user stops: the table has the same bytes."""

import contextlib
import os
import socket
import subprocess
import sys
import threading
from pathlib import Path

import pytest

import ambient_trainer as at
from ambient_trainer.fleet.dataset import write_dataset
from ambient_trainer.simulator.fleet import FleetPlan, fleet
from processes import free_port, is_listening, wait_until

EFFORT = at.Effort(starts=1)


@pytest.fixture(scope="module")
def many(tmp_path_factory):
    """Enough units for six chunks."""
    folder = str(tmp_path_factory.mktemp("many") / "logs")
    units = fleet(FleetPlan("5", 260, seed=5, period_s=10.0, minutes=20.0))
    write_dataset(folder, ((each.name, each.trace, {"case": each.case}) for each in units))
    return folder


@pytest.fixture(scope="module")
def expected(many, tmp_path_factory):
    folder = tmp_path_factory.mktemp("expected")
    at.fit_fleet(many, "free-1", folder, engine="serial", effort=EFFORT)
    return (folder / "fleet.parquet").read_bytes()


@contextlib.contextmanager
def cluster(folder: Path, workers: int = 2):
    """A scheduler and workers as processes of their own; their address and the workers' processes."""
    folder.mkdir(exist_ok=True)
    port = free_port()
    environment = {**os.environ, "TMPDIR": str(folder), "HOME": str(folder), "OPENBLAS_NUM_THREADS": "1"}
    dask = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--port", str(port), "--no-dashboard"]
    address = f"tcp://127.0.0.1:{port}"
    with open(folder / "log", "w") as log:
        where = {"cwd": folder, "env": environment, "stdout": log, "stderr": log}
        processes = [subprocess.Popen([*dask, "--host", "127.0.0.1"], **where)]
        worker = [sys.executable, "-m", "distributed.cli.dask_worker", address, "--nthreads", "1", "--no-dashboard"]
        worker += ["--local-directory", str(folder), "--no-nanny"]
        try:
            wait_until(lambda: is_listening(port), "the scheduler does not listen", 60.0)
            processes += [subprocess.Popen(worker, **where) for _ in range(workers)]
            yield address, processes, lambda: processes.append(subprocess.Popen(worker, **where))
        finally:
            for each in processes:
                each.kill()
                each.wait(20)


@pytest.mark.slow
@pytest.mark.parametrize("jobs", [1, 2])
def test_the_number_of_workers_changes_no_byte(many, expected, tmp_path, jobs):
    at.fit_fleet(many, "free-1", tmp_path, jobs=jobs, effort=EFFORT)
    assert (tmp_path / "fleet.parquet").read_bytes() == expected


@pytest.mark.slow
def test_workers_that_are_killed_change_no_byte(many, expected, tmp_path):
    killed = []
    with cluster(tmp_path / "cluster") as (address, processes, another):

        def kill(what, done, total):
            if done and len(killed) < 3:
                processes[1 + len(killed)].kill()
                killed.append(what)
                another()

        at.fit_fleet(many, "free-1", tmp_path, engine=address, effort=EFFORT, progress=kill)
    assert len(killed) == 3
    assert (tmp_path / "fleet.parquet").read_bytes() == expected


class Relay:
    """A connection to another port that can be cut."""

    def __init__(self, port: int) -> None:
        self._port = port
        self._pairs: list[socket.socket] = []
        self._server = socket.create_server(("127.0.0.1", 0))
        self.address = f"tcp://127.0.0.1:{self._server.getsockname()[1]}"
        threading.Thread(target=self._serve, daemon=True).start()

    def _serve(self) -> None:
        with contextlib.suppress(OSError):
            while True:
                near, _ = self._server.accept()
                far = socket.create_connection(("127.0.0.1", self._port))
                self._pairs += [near, far]
                for one, other in ((near, far), (far, near)):
                    threading.Thread(target=self._copy, args=(one, other), daemon=True).start()

    @staticmethod
    def _copy(one: socket.socket, other: socket.socket) -> None:
        with contextlib.suppress(OSError):
            while data := one.recv(65536):
                other.sendall(data)
            other.shutdown(socket.SHUT_WR)

    def cut(self) -> None:
        pairs, self._pairs = self._pairs, []
        for each in pairs:
            with contextlib.suppress(OSError):
                each.shutdown(socket.SHUT_RDWR)
            each.close()

    def close(self) -> None:
        self._server.close()
        self.cut()


@pytest.mark.slow
@pytest.mark.filterwarnings("default")
def test_a_connection_that_is_cut_is_made_anew(many, expected, tmp_path):
    cuts = []
    with cluster(tmp_path / "cluster") as (address, _, _):
        relay = Relay(int(address.rpartition(":")[2]))

        def cut(what, done, total):
            if what.startswith("summarising") and done == 2 and not cuts:
                cuts.append(what)
                relay.cut()

        try:
            at.fit_fleet(many, "free-1", tmp_path, engine=relay.address, effort=EFFORT, progress=cut)
        finally:
            relay.close()
    assert cuts
    assert (tmp_path / "fleet.parquet").read_bytes() == expected


@pytest.mark.slow
def test_ctrl_c_and_resume(many, expected, interrupted, trainer, tmp_path):
    asked = ("fleet", many, "--circuit", "free-1", "--starts", 1, "--jobs", 2, "-o", tmp_path / "fitted")
    status, _, shown = interrupted("fitting units", *asked)  # a stage: the bar may miss a count
    assert status == 1
    assert "Traceback" not in shown
    assert list((tmp_path / "fitted" / ".parts").glob("look-*"))
    status, _, err = trainer(*asked, "--resume")
    assert status == 0, err
    assert (tmp_path / "fitted" / "fleet.parquet").read_bytes() == expected


@pytest.mark.slow
def test_two_clusters_share_nothing_but_the_dataset(many, expected, tmp_path):
    """Half the run on one, the rest on another, whose folders are others and which see the dataset only."""

    def stop(what, done, total):
        if what.startswith("summarising") and done == 3:
            raise KeyboardInterrupt

    with cluster(tmp_path / "one") as (address, _, _), pytest.raises(KeyboardInterrupt):
        at.fit_fleet(many, "free-1", tmp_path / "out", engine=address, effort=EFFORT, progress=stop)
    with cluster(tmp_path / "two") as (address, _, _):
        at.fit_fleet(many, "free-1", tmp_path / "out", engine=address, effort=EFFORT, resume=True)
    assert (tmp_path / "out" / "fleet.parquet").read_bytes() == expected
    for folder in ("one", "two"):
        assert not {each.name for each in (tmp_path / folder).rglob("*.pickle")}
