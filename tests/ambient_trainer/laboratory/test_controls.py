"""What asks and keeps the instruments: a chamber and a load are where they are wanted, on an absolute schedule."""

import math
import os
import queue

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ambient_trainer.laboratory.campaign import Action, load_campaign
from ambient_trainer.laboratory.instruments import settings
from ambient_trainer.laboratory.instruments import voetsch_vt4004 as voetsch
from ambient_trainer.laboratory.messages import Clock, Failure, LoadState, Reading
from ambient_trainer.laboratory.shell import connection_to
from ambient_trainer.laboratory.workers import ChamberControl, LoadControl, Sampler, Target
from ambient_trainer.simulator.scenario import scenario_path
from breaking import mute

SHIPPED = load_campaign(scenario_path("1"), ports=False).campaign.laboratory


class Controlled:
    """A simulated chamber, or a device, under control."""

    def __init__(self, until, driver_of):
        self.posted: queue.Queue = queue.Queue()
        self.until, self.driver_of = until, driver_of

    def chamber(self, target):
        self.clock = Clock(100.0)
        self.simulated = voetsch.Simulated(settings("voetsch-vt4004", port=""), self.clock)
        driver = self.driver_of(settings("voetsch-vt4004", port=self.simulated.port), self.clock)
        self.control = ChamberControl(driver, self.clock, self.posted.put, 10.0, target, 120.0)
        self.control.start()
        self.until(lambda: self.control.confirmed)
        return self

    def load(self, phone, actions, setup=""):
        changes = {"actions": actions, "device": SHIPPED.device.model_copy(update={"setup": setup})}
        connection = connection_to("adb", phone.environment)
        self.control = LoadControl(SHIPPED.model_copy(update=changes), connection, Clock(10.0), self.posted.put)
        self.control.start()
        self.next(LoadState)
        return self

    def next(self, kind):
        while not isinstance(message := self.posted.get(timeout=20.0), kind):
            pass
        return message

    def close(self):
        self.control.finish()
        self.control.join(20.0)
        assert not self.control.is_alive()
        if hasattr(self, "simulated"):
            self.simulated.close()


@pytest.fixture
def kept(until, closed, driver_of):
    return lambda: closed(Controlled(until, driver_of))


def test_a_pulled_cable_a_lost_answer_and_somebody_else_leave_the_target_in_force(kept):
    lab = kept().chamber(Target(45.0))
    lab.simulated.unplug()
    lab.control.go_to(Target(20.0, urgent=True))
    assert "expected" in lab.next(Failure).text
    assert not lab.control.confirmed
    assert lab.simulated.held_degC == 45.0
    lab.simulated.plug()
    lab.until(lambda: lab.control.confirmed)
    assert lab.simulated.held_degC == 20.0
    mute(lab.simulated)
    lab.control.go_to(Target(45.0))
    lab.until(lambda: lab.simulated.held_degC == 45.0)  # it receives
    lab.next(Failure)
    assert not lab.control.confirmed
    mute(lab.simulated, False)
    lab.until(lambda: lab.control.confirmed)
    lab.simulated.put((5.0, 0.0, 0.0, 0.0, 0.0), (False,) * 16)  # as after a power cut
    assert lab.simulated.held_degC is None
    lab.until(lambda: lab.simulated.held_degC == 45.0)


def marks(folder):
    """Actions that leave a mark for each start and stop."""
    log = folder / "log"
    return {
        name: Action(start=f"echo +{name} >>{log}", stop=f"echo -{name} >>{log}", signals={})
        for name in ("load", "camera")
    }


def test_it_begins_with_no_action_and_changes_only_what_it_must(kept, phone, tmp_path):
    running = kept().load(phone, marks(tmp_path))
    assert running.control.confirmed
    for target in (("load", "camera"), ("camera",)):
        running.control.go_to(target)
        assert running.next(LoadState).actions == target
    assert (tmp_path / "log").read_text().split() == ["-load", "-camera", "+load", "+camera", "-load"]


def test_the_load_of_a_lost_device_is_unknown_until_it_is_set_again(kept, phone, tmp_path):
    running = kept().load(phone, marks(tmp_path))
    running.control.go_to(("load",))
    running.next(LoadState)
    phone.pull()
    assert running.next(LoadState).actions is None
    assert "no devices/emulators found" in running.next(Failure).text
    phone.plug()
    assert [running.next(LoadState).actions for _ in range(2)] == [(), ("load",)]
    assert (tmp_path / "log").read_text().split()[2:] == ["+load", "-load", "-camera", "+load"]


def test_a_command_that_fails_is_reported_and_tried_again(kept, one_phone, tmp_path):
    running = kept().load(one_phone, {"load": Action(start=f"[ -e {tmp_path}/ready ]", stop=":", signals={})})
    running.control.go_to(("load",))
    assert running.next(LoadState).actions is None
    text = running.next(Failure).text
    assert all(part in text for part in ("device on adb", "action load to start", "exit status 1"))
    (tmp_path / "ready").touch()
    while (actions := running.next(LoadState).actions) != ("load",):
        assert actions in ((), None)


def test_the_shipped_load_runs_as_many_loops_as_asked_and_ends_them(kept, phone, tmp_path):
    ours = tmp_path / "ambient-load"
    setup = SHIPPED.device.setup.replace("/data/local/tmp/ambient-load", str(ours))
    assert str(ours) in setup
    # two loops that sleep instead of as many as there are cores that burn
    actions = {"cpu_100": SHIPPED.actions["cpu_100"].model_copy(update={"start": "busy 2"})}
    running = kept().load(phone, actions, setup.replace("while :; do :; done", "sleep 1000"))
    running.control.go_to(("cpu_100",))
    assert running.next(LoadState).actions == ("cpu_100",)
    pids = ours.read_text().split()
    assert [os.path.exists(f"/proc/{pid}") for pid in pids] == [True, True]
    running.control.go_to(())
    assert running.next(LoadState).actions == ()
    assert not ours.exists()
    running.control.finish()
    running.until(lambda: not any(os.path.exists(f"/proc/{pid}") for pid in pids))


def test_commands_of_the_shipped_laboratory_are_shell(kept, phone):
    """Every one is parsed by the shell, none is run."""
    texts = [SHIPPED.device.setup]
    texts += [text for action in SHIPPED.actions.values() for text in (action.start, action.stop)]
    running = kept().load(phone, {})
    assert {running.control.shell.run(f"unused() {{\n{text}\n}}").status for text in texts} == {0}


class StillClock:
    """Time that passes by waiting and by asking, and else not at all."""

    time_s = 0.0

    def now_s(self):
        return self.time_s

    def wait(self, event, duration_s):
        self.time_s += max(duration_s, 1e-9)  # never nothing, as of a machine
        return event.is_set()


class Slow:
    """An instrument that takes so long for each of its readings, and then has done its last one."""

    def __init__(self, clock, durations_s):
        self.clock, self.left = clock, list(durations_s)
        self.closed = False

    def read(self):
        asked_s = self.clock.now_s()
        self.clock.time_s += self.left.pop(0)
        if not self.left:
            self.sampler.finish()
        return Reading(asked_s, self.clock.now_s(), {})

    def close(self):
        self.closed = True


@given(st.lists(st.floats(0.0, 5.0), min_size=1, max_size=20), st.floats(0.05, 3.0))
def test_every_sample_is_asked_for_at_a_multiple_of_its_own(durations_s, period_s):
    clock, posted = StillClock(), []
    instrument = Slow(clock, durations_s)
    instrument.sampler = Sampler("x", instrument, period_s, clock, posted.append)
    instrument.sampler.run()
    assert instrument.closed
    places = [sample.asked_s / period_s for sample in posted]
    assert all(math.isclose(place, round(place), rel_tol=1e-9, abs_tol=1e-6) for place in places)
    assert len({round(place) for place in places}) == len(places)
