"""The load of the device, over a real shell."""

import os
import queue
import time

import pytest

from ambient_trainer.laboratory.campaign import Action, load_campaign
from ambient_trainer.laboratory.messages import Clock, Failure, LoadState
from ambient_trainer.laboratory.shell import connection_to
from ambient_trainer.laboratory.workers import LoadControl
from ambient_trainer.simulator.scenario import scenario_path

SHIPPED = load_campaign(scenario_path("1"), ports=False).campaign.laboratory


class Running:
    """A load control at work, and what it posts, in order."""

    def __init__(self, phone, actions, setup=""):
        changes = {"actions": actions, "device": SHIPPED.device.model_copy(update={"setup": setup})}
        self.posted: queue.Queue = queue.Queue()
        connection, clock = connection_to("adb", phone.environment), Clock(10.0)
        self.control = LoadControl(SHIPPED.model_copy(update=changes), connection, clock, self.posted.put)
        self.control.start()

    def next(self, kind):
        while not isinstance(message := self.posted.get(timeout=20.0), kind):
            pass
        return message

    def close(self):
        self.control.finish()
        self.control.join(10.0)
        assert not self.control.is_alive()


@pytest.fixture
def run():
    made = []

    def make(*arguments):
        made.append(Running(*arguments))
        return made[-1]

    yield make
    for each in made:
        each.close()


def marks(folder):
    """Actions that leave a mark for each start and stop."""
    log = folder / "log"
    return {
        name: Action(start=f"echo +{name} >>{log}", stop=f"echo -{name} >>{log}", signals={})
        for name in ("load", "camera")
    }


def test_it_begins_with_no_action_and_changes_only_what_it_must(run, phone, tmp_path):
    running = run(phone, marks(tmp_path))
    assert running.next(LoadState).actions == ()
    for target in (("load", "camera"), ("camera",)):
        running.control.go_to(target)
        assert running.next(LoadState).actions == target
    assert (tmp_path / "log").read_text().split() == ["-load", "-camera", "+load", "+camera", "-load"]


def test_the_load_of_a_lost_device_is_unknown_until_it_is_set_again(run, phone, tmp_path):
    running = run(phone, marks(tmp_path))
    running.next(LoadState)
    running.control.go_to(("load",))
    running.next(LoadState)
    phone.pull()
    assert running.next(LoadState).actions is None
    assert "no devices/emulators found" in running.next(Failure).text
    phone.plug()
    assert [running.next(LoadState).actions for _ in range(2)] == [(), ("load",)]
    assert (tmp_path / "log").read_text().split()[2:] == ["+load", "-load", "-camera", "+load"]


def test_a_command_that_fails_is_reported_and_tried_again(run, one_phone, tmp_path):
    running = run(one_phone, {"load": Action(start=f"[ -e {tmp_path}/ready ]", stop=":", signals={})})
    running.next(LoadState)
    running.control.go_to(("load",))
    assert running.next(LoadState).actions is None
    text = running.next(Failure).text
    assert all(part in text for part in ("device on adb", "action load to start", "exit status 1"))
    (tmp_path / "ready").touch()
    while (actions := running.next(LoadState).actions) != ("load",):
        assert actions in ((), None)


def test_the_shipped_load_runs_as_many_loops_as_asked_and_ends_them(run, phone, tmp_path):
    ours = tmp_path / "ambient-load"
    setup = SHIPPED.device.setup.replace("/data/local/tmp/ambient-load", str(ours))
    assert str(ours) in setup
    # two loops that sleep instead of as many as there are cores that burn
    actions = {"cpu_100": SHIPPED.actions["cpu_100"].model_copy(update={"start": "busy 2"})}
    running = run(phone, actions, setup.replace("while :; do :; done", "sleep 1000"))
    running.next(LoadState)
    running.control.go_to(("cpu_100",))
    assert running.next(LoadState).actions == ("cpu_100",)
    pids = ours.read_text().split()
    assert [os.path.exists(f"/proc/{pid}") for pid in pids] == [True, True]
    running.control.go_to(())
    assert running.next(LoadState).actions == ()
    assert not ours.exists()
    running.close()
    deadline = time.monotonic() + 4.0
    while any(os.path.exists(f"/proc/{pid}") for pid in pids):
        assert time.monotonic() < deadline
        time.sleep(0.02)


def test_commands_of_the_shipped_laboratory_are_shell(run, phone):
    """Every one is parsed by the shell, none is run."""
    texts = [SHIPPED.device.setup]
    texts += [text for action in SHIPPED.actions.values() for text in (action.start, action.stop)]
    running = run(phone, {})
    running.next(LoadState)
    assert {running.control.shell.run(f"unused() {{\n{text}\n}}").status for text in texts} == {0}
