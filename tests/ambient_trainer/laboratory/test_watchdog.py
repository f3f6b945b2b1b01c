"""The process that is left when the collector is killed."""

import contextlib
import subprocess
import threading
import time

import pytest

from ambient_trainer.laboratory.instruments import ChamberLimits, settings
from ambient_trainer.laboratory.instruments.voetsch_vt4004 import Driver, Simulated
from ambient_trainer.laboratory.messages import Clock
from ambient_trainer.laboratory.watchdog import Watchdog
from ambient_trainer.laboratory.workers import Target
from breaking import mute

SAFE_DEGC = 20.0


def watchdog_at(port):
    return Watchdog(settings("voetsch-vt4004", port=port, timeout_s=1.0), Target(SAFE_DEGC, urgent=True), "/gone/log")


def driver_at(port):
    return Driver(settings("voetsch-vt4004", port=port), Clock(50.0), ChamberLimits(low_degC=-20.0, high_degC=60.0))


@pytest.fixture
def chamber(closed):
    """At 50 degC."""
    simulated = closed(Simulated(settings("voetsch-vt4004", port=""), Clock(50.0)))
    with contextlib.closing(driver_at(simulated.port)) as driver:
        driver.set_point(50.0)
    return simulated


@pytest.fixture
def process(chamber, spawn):
    """A watchdog with the pipe in our hands."""
    return spawn(watchdog_at(chamber.port).argv, stdin=subprocess.PIPE)


def ends(process):
    process.stdin.close()
    assert process.wait(timeout=30) == 0


@pytest.mark.parametrize("away", [False, True])
def test_the_end_of_the_pipe_is_a_death_also_with_the_chamber_away(chamber, process, away):
    if away:
        chamber.unplug()
        threading.Timer(1.5, chamber.plug).start()
    time.sleep(0.3)
    assert chamber.held_degC == 50.0
    ends(process)
    assert chamber.held_degC == SAFE_DEGC


@pytest.mark.parametrize(
    ("error", "taken_over", "held_degC"), [(None, True, SAFE_DEGC), (KeyError, False, SAFE_DEGC), (None, False, 50.0)]
)
def test_it_takes_over_where_it_is_asked_to_or_after_an_error(chamber, error, taken_over, held_degC):
    with contextlib.suppress(KeyError), watchdog_at(chamber.port) as watchdog:
        if taken_over:
            watchdog.take_over()
        if error:
            raise error
    assert watchdog.process.wait(timeout=30) == 0
    assert chamber.held_degC == held_degC


def test_it_is_started_again_after_its_own_death_and_an_error_once_it_dies_too_often(chamber):
    with watchdog_at(chamber.port) as watchdog:
        for deaths in range(1, 6):
            watchdog.process.kill()
            watchdog.process.wait()
            with contextlib.nullcontext() if deaths <= 3 else pytest.raises(OSError, match=f"{deaths} times"):
                assert "started again" in watchdog.check()
        watchdog.take_over()
    assert (watchdog.process.wait(timeout=30), chamber.held_degC) == (0, SAFE_DEGC)


def test_a_chamber_that_hears_and_does_not_answer_is_sent_to_safety(chamber, process, until):
    mute(chamber)
    process.stdin.close()
    until(lambda: chamber.held_degC == SAFE_DEGC)


def test_a_collector_that_was_started_again_has_the_chamber(chamber, process, closed):
    closed(driver_at(chamber.port)).read()  # holds the port
    ends(process)
    assert chamber.held_degC == 50.0


def test_a_chamber_that_was_stopped_stays_so(chamber, process):
    with contextlib.closing(driver_at(chamber.port)) as driver:
        driver.read()
        driver.stop()
    ends(process)
    assert chamber.held_degC is None
