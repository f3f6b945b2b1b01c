"""A small simulated fleet as a Parquet dataset."""

import gc
import socket
import warnings

import pytest

from ambient_trainer.fleet.dataset import write_dataset
from ambient_trainer.simulator.fleet import FleetPlan, fleet

PLAN = FleetPlan("5", 14, seed=3, period_s=10.0, minutes=60.0)


@pytest.fixture(autouse=True)
def _sockets_of_a_cluster():
    """Those that killed processes and cut connections leave to the garbage collector go here, not in another test; one
    that an error still holds is closed."""
    yield
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ResourceWarning)
        gc.collect()
        for each in gc.get_objects():
            if type(each) is socket.socket and each.family == socket.AF_INET:
                each.close()


@pytest.fixture(scope="session")
def fleet_units():
    return list(fleet(PLAN))


@pytest.fixture(scope="session")
def logs(fleet_units, tmp_path_factory):
    """Fourteen units of an hour, five a file."""
    folder = str(tmp_path_factory.mktemp("fleet") / "logs")
    write_dataset(folder, ((each.name, each.trace, {"case": each.case}) for each in fleet_units), each=5)
    return folder
