"""The process that is left when the collector is killed."""

import subprocess
import threading
import time

import pytest

from ambient_trainer.laboratory.clock import Clock
from ambient_trainer.laboratory.instruments import settings
from ambient_trainer.laboratory.instruments import voetsch_vt4004 as voetsch
from ambient_trainer.laboratory.set_point_limits import SetPointLimits
from ambient_trainer.laboratory.watchdog import Watchdog

SAFE_DEGC = 20.0


def settings_at(port):
    return settings("voetsch-vt4004", port=port, timeout_s=1.0)


def driver_at(port):
    return voetsch.Driver(settings_at(port), Clock(50.0), SetPointLimits(port, -20.0, 60.0))


@pytest.fixture
def chamber():
    simulated = voetsch.Simulated(settings("voetsch-vt4004", port=""), Clock(50.0))
    driver = driver_at(simulated.port)
    driver.set_point(50.0)
    driver.close()
    yield simulated
    simulated.close()


@pytest.fixture
def guard():
    """Start one as a collector does, with the pipe in our hands."""
    started = []

    def start(port):
        arguments = Watchdog(settings_at(port), SAFE_DEGC).argv
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
    with Watchdog(settings_at(chamber.port), SAFE_DEGC) as guard:
        guard.take_over()
    assert guard.process.wait(timeout=30) == 0
    assert chamber.held_degC == 20.0


def test_an_error_that_came_through_everything_is_no_farewell(chamber):
    with pytest.raises(KeyError), Watchdog(settings_at(chamber.port), SAFE_DEGC) as guard:
        raise KeyError
    assert guard.process.wait(timeout=30) == 0
    assert chamber.held_degC == 20.0


def test_a_farewell_is_none(chamber):
    with Watchdog(settings_at(chamber.port), SAFE_DEGC):
        pass
    assert chamber.held_degC == 50.0


def test_a_collector_that_was_started_again_has_the_chamber(chamber, guard):
    driver = driver_at(chamber.port)
    driver.read()  # holds the port
    process = guard(chamber.port)
    process.stdin.close()
    assert process.wait(timeout=30) == 0
    assert chamber.held_degC == 50.0
    driver.close()


def test_a_chamber_that_was_stopped_stays_so(chamber, guard):
    driver = driver_at(chamber.port)
    driver.read()
    driver.stop()
    driver.close()
    process = guard(chamber.port)
    process.stdin.close()
    assert process.wait(timeout=30) == 0
    assert chamber.held_degC is None
