"""What the device is made to do, over a real shell."""

import os
import queue
import threading

import pytest

from ambient_trainer.laboratory.campaign import Action, load_campaign
from ambient_trainer.laboratory.clock import Clock
from ambient_trainer.laboratory.device.shell import connection_to
from ambient_trainer.laboratory.load_control import LoadControl
from ambient_trainer.laboratory.messages import Failure, LoadState, Timebase
from ambient_trainer.simulator.scenario import scenario_path


class Running:
    """A doer at work; what it tells, in order."""

    def __init__(self, phone, actions, setup=""):
        laboratory = load_campaign(scenario_path("1"), ports=False).campaign.laboratory
        device = laboratory.device.model_copy(update={"setup": setup})
        self.told: queue.Queue = queue.Queue()
        self.control = LoadControl(
            laboratory.model_copy(update={"actions": actions, "device": device}),
            connection_to("adb", phone.environment),
            Timebase(Clock(10.0), 0.0),
            self.told.put,
        )
        self.control.start()

    def next(self, kind):
        """The next message of that kind."""
        while not isinstance(message := self.told.get(timeout=20.0), kind):
            pass
        return message

    def close(self):
        self.control.finish()
        self.control.join(10.0)
        assert not self.control.is_alive()


def marks(folder, name):
    """An action that leaves a mark for each start and stop, and complains where it is stopped twice."""
    return Action(start=f"echo +{name} >>{folder}/log", stop=f"echo -{name} >>{folder}/log", signals={})


@pytest.fixture
def running(phone, tmp_path):
    made = Running(phone, {name: marks(tmp_path, name) for name in ("load", "camera")})
    yield made
    made.close()


def log(folder):
    return (folder / "log").read_text().split()


def test_it_begins_at_rest_and_changes_only_what_it_must(running, tmp_path):
    assert running.next(LoadState).actions == ()
    assert log(tmp_path) == ["-load", "-camera"]
    running.control.go_to(("load", "camera"))
    assert running.next(LoadState).actions == ("load", "camera")
    running.control.go_to(("camera",))
    assert running.next(LoadState).actions == ("camera",)
    assert log(tmp_path)[2:] == ["+load", "+camera", "-load"]


def test_what_a_lost_device_does_is_not_known_until_it_does_it_again(running, phone, tmp_path):
    running.next(LoadState)
    running.control.go_to(("load",))
    running.next(LoadState)
    phone.pull()
    assert running.next(LoadState).actions is None
    assert "no devices/emulators found" in running.next(Failure).text
    phone.plug()
    assert running.next(LoadState).actions == ()
    assert running.next(LoadState).actions == ("load",)
    assert log(tmp_path)[2:] == ["+load", "-load", "-camera", "+load"]


def test_a_command_that_fails_is_said_and_tried_again(one_phone, tmp_path):
    running = Running(one_phone, {"load": Action(start=f"[ -e {tmp_path}/ready ]", stop=":", signals={})})
    running.next(LoadState)
    running.control.go_to(("load",))
    assert running.next(LoadState).actions is None
    trouble = running.next(Failure).text
    assert trouble.startswith("device on adb: expected action load to start, got exit status 1; try the command")
    (tmp_path / "ready").touch()
    while (doing := running.next(LoadState).actions) != ("load",):
        assert doing in ((), None)
    running.close()


def test_the_shipped_load_runs_as_many_loops_as_asked_and_ends_them(phone, tmp_path):
    laboratory = load_campaign(scenario_path("1"), ports=False).campaign.laboratory
    ours = tmp_path / "ambient-load"
    setup = laboratory.device.setup.replace("/data/local/tmp/ambient-load", str(ours))
    assert str(ours) in setup
    # two loops that sleep instead of as many as there are cores that burn
    actions = {
        "cpu_100": laboratory.actions["cpu_100"].model_copy(
            update={"start": "busy 2", "stop": laboratory.actions["cpu_100"].stop}
        )
    }
    running = Running(phone, actions, setup.replace("while :; do :; done", "sleep 1000"))
    running.next(LoadState)
    running.control.go_to(("cpu_100",))
    assert running.next(LoadState).actions == ("cpu_100",)
    pids = ours.read_text().split()
    assert len(pids) == 2
    for pid in pids:
        os.kill(int(pid), 0)
    running.control.go_to(())
    assert running.next(LoadState).actions == ()
    assert not ours.exists()
    running.close()
    ended = threading.Event()
    for _ in range(200):
        if not any(os.path.exists(f"/proc/{pid}") for pid in pids):
            break
        ended.wait(0.02)
    assert not any(os.path.exists(f"/proc/{pid}") for pid in pids)


def test_commands_of_the_shipped_laboratory_are_shell(phone):
    """Every one is parsed by the shell, none is run."""
    laboratory = load_campaign(scenario_path("1"), ports=False).campaign.laboratory
    texts = [laboratory.device.setup]
    texts += [text for action in laboratory.actions.values() for text in (action.start, action.stop)]
    running = Running(phone, {})
    running.next(LoadState)
    for text in texts:
        assert running.control.shell.run(f"unused() {{\n{text}\n}}").status == 0
    running.close()
