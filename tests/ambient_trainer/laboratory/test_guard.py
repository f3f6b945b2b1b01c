"""The process that is left when the collector is killed."""

import subprocess
import sys
import threading
import time

import pytest

from ambient_trainer.laboratory.clock import FastClock
from ambient_trainer.laboratory.guard import Guard
from ambient_trainer.laboratory.instruments.chamber import Chamber
from ambient_trainer.laboratory.simulated.chamber import SimulatedChamber

ARGUMENTS = ("20.0", "0.0", "1.0")


@pytest.fixture
def chamber():
    clock = FastClock(50.0)
    simulated = SimulatedChamber(clock, room_degC=22.0)
    driver = Chamber(simulated.port, -20.0, 60.0, clock=clock)
    driver.set_point(50.0)
    driver.close()
    yield simulated
    simulated.close()


@pytest.fixture
def guard():
    """Start one as a collector does, with the pipe in our hands."""
    started = []

    def start(port):
        arguments = [sys.executable, "-m", "ambient_trainer.laboratory.guard", port, *ARGUMENTS]
        started.append(subprocess.Popen(arguments, stdin=subprocess.PIPE))
        return started[-1]

    yield start
    for process in started:
        process.kill()
        process.wait()
        process.stdin.close()


def test_the_end_of_the_pipe_is_a_death(chamber, guard):
    process = guard(chamber.port)
    time.sleep(0.3)
    assert chamber.held_degC == 50.0
    process.stdin.close()
    assert process.wait(timeout=30) == 0
    assert chamber.held_degC == 20.0


def test_it_waits_for_a_chamber_that_is_away(chamber, guard):
    chamber.unplug()
    process = guard(chamber.port)
    process.stdin.close()
    threading.Timer(1.5, chamber.plug).start()
    assert process.wait(timeout=30) == 0
    assert chamber.held_degC == 20.0


def test_who_could_not_wait_for_the_chamber_leaves_it_to_the_guard(chamber):
    with Guard(chamber.port, 20.0, 0.0, 1.0) as guard:
        guard.take_over()
    assert guard._process.wait(timeout=30) == 0
    assert chamber.held_degC == 20.0


def test_an_error_that_came_through_everything_is_no_farewell(chamber):
    with pytest.raises(KeyError), Guard(chamber.port, 20.0, 0.0, 1.0) as guard:
        raise KeyError
    assert guard._process.wait(timeout=30) == 0
    assert chamber.held_degC == 20.0


def test_a_farewell_is_none(chamber):
    with Guard(chamber.port, 20.0, 0.0, 1.0):
        pass
    assert chamber.held_degC == 50.0


def test_a_collector_that_was_started_again_has_the_chamber(chamber, guard):
    driver = Chamber(chamber.port, -20.0, 60.0, clock=FastClock(50.0))
    driver.read()  # holds the port
    process = guard(chamber.port)
    process.stdin.close()
    assert process.wait(timeout=30) == 0
    assert chamber.held_degC == 50.0
    driver.close()


def test_a_chamber_that_was_stopped_stays_so(chamber, guard):
    driver = Chamber(chamber.port, -20.0, 60.0, clock=FastClock(50.0))
    driver.read()
    driver.stop()
    driver.close()
    process = guard(chamber.port)
    process.stdin.close()
    assert process.wait(timeout=30) == 0
    assert chamber.held_degC is None
