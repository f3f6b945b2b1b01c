"""The chamber is where it is wanted, whatever happens to it on the way: over a pseudo-terminal, in fast time."""

import queue
import time

import pytest

from ambient_trainer.laboratory.instruments import settings
from ambient_trainer.laboratory.instruments import voetsch_vt4004 as voetsch
from ambient_trainer.laboratory.messages import Clock, Failure, Sample
from ambient_trainer.laboratory.set_point_limits import SetPointLimits
from ambient_trainer.laboratory.workers import ChamberControl, Target


class Controlled:
    """A simulated chamber under control."""

    def __init__(self, target, gradients=False):
        self.clock = Clock(100.0)
        self.simulated = voetsch.Simulated(settings("voetsch-vt4004", port=""), self.clock)
        self.posted: queue.Queue = queue.Queue()
        port = self.simulated.port
        limits = SetPointLimits(port, -20.0, 60.0)
        driver = voetsch.Driver(settings("voetsch-vt4004", port=port), self.clock, limits)
        self.control = ChamberControl(driver, self.clock, self.posted.put, 10.0, target, gradients, 120.0)
        self.control.start()

    def until(self, condition):
        deadline = time.monotonic() + 20.0
        while not condition():
            assert time.monotonic() < deadline, "it never came to that"
            time.sleep(0.005)

    def next(self, kind):
        while not isinstance(message := self.posted.get(timeout=20.0), kind):
            pass
        return message

    def close(self):
        self.control.finish()
        self.control.join(20.0)
        self.simulated.close()


@pytest.fixture
def kept():
    made = []

    def make(*arguments):
        made.append(Controlled(*arguments))
        return made[-1]

    yield make
    for each in made:
        each.close()


def test_a_target_is_sent_and_confirmed_by_the_chamber_s_own_word(kept):
    lab = kept(Target(45.0))
    lab.until(lambda: lab.control.confirmed)
    assert lab.simulated.held_degC == 45.0
    lab.control.go_to(Target(-5.5))
    assert not lab.control.confirmed
    lab.until(lambda: lab.control.confirmed)
    assert lab.simulated.held_degC == -5.5
    sample = lab.next(Sample)
    assert set(sample.values) == {"chamber_set_degC", "chamber_degC", "chamber_on"}


def test_a_cable_that_was_pulled_meanwhile(kept):
    lab = kept(Target(45.0))
    lab.until(lambda: lab.control.confirmed)
    lab.simulated.unplug()
    lab.control.go_to(Target(20.0, urgent=True))
    assert "expected" in lab.next(Failure).text
    assert not lab.control.confirmed
    assert lab.simulated.held_degC == 45.0
    lab.simulated.plug()
    lab.until(lambda: lab.control.confirmed)
    assert lab.simulated.held_degC == 20.0


def test_an_answer_that_is_lost_is_no_confirmation(kept):
    lab = kept(Target(45.0))
    lab.until(lambda: lab.control.confirmed)
    lab.simulated.muted = True
    lab.control.go_to(Target(20.0))
    lab.until(lambda: lab.simulated.held_degC == 20.0)  # it receives
    lab.next(Failure)
    assert not lab.control.confirmed
    lab.simulated.muted = False
    lab.until(lambda: lab.control.confirmed)


def test_a_chamber_that_somebody_else_turned_is_turned_back(kept):
    lab = kept(Target(45.0))
    lab.until(lambda: lab.control.confirmed)
    lab.simulated.put((5.0, 0.0, 0.0, 0.0, 0.0), (False,) * 16)  # as after a power cut
    assert lab.simulated.held_degC is None
    lab.until(lambda: lab.simulated.held_degC == 45.0)


def test_a_gradient_goes_out_first_but_after_an_urgent_set_point(kept):
    lab = kept(Target(45.0, gradient_K_min=0.5), True)
    lab.until(lambda: lab.control.confirmed)
    began_s, began_degC = lab.clock.now_s(), lab.simulated.air_degC()
    lab.clock.sleep(300.0)
    rise_K_min = 60.0 * (lab.simulated.air_degC() - began_degC) / (lab.clock.now_s() - began_s)
    assert rise_K_min < 1.0  # 0.5, and the swing about it; without, 2.2
    lab.control.go_to(Target(20.0, urgent=True))
    lab.until(lambda: lab.control.confirmed)
    assert lab.simulated.held_degC == 20.0


def test_a_stop_is_confirmed_and_an_alarm_reported(kept):
    lab = kept(Target(45.0))
    lab.until(lambda: lab.control.confirmed)
    lab.simulated.raise_alarm(7, "overtemperature")
    lab.control.go_to(Target(None))
    lab.until(lambda: lab.control.confirmed)
    assert lab.simulated.held_degC is None
    while (note := lab.next(Sample).note) is None:
        pass
    assert note == "07 overtemperature"
