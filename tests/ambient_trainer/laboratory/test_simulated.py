"""The simulated chamber's air against that of the simulation, and pseudo-terminals against the speed of a wire."""

import math
import os
import select
import threading

import numpy as np
import pytest

from ambient_trainer.laboratory.instruments import settings
from ambient_trainer.laboratory.instruments.voetsch_vt4004 import Simulated
from ambient_trainer.laboratory.messages import Clock
from ambient_trainer.simulator.chamber import Chamber as Dynamics
from ambient_trainer.simulator.chamber import ramped
from ambient_trainer.simulator.live import ChamberAir

STILL = Dynamics(heating_K_min=2.0, cooling_K_min=1.5, wobble_degC=0.0)
SWINGING = Dynamics(heating_K_min=2.0, cooling_K_min=1.5, wobble_degC=1.0)
CHAMBER = settings("voetsch-vt4004", port="")


def air(dynamics: Dynamics = STILL) -> ChamberAir:
    made = ChamberAir(100.0, 20.0, 0, dynamics)
    made._draught = 0.0
    return made


def mean(made: ChamberAir, at_s: float) -> float:
    """Without draughts."""
    made.at(at_s)
    return made._mean_degC


def test_its_air_is_that_of_the_simulated_phones_chamber():
    wanted = np.concatenate([np.full(60, 20.0), np.full(1200, 35.0), np.full(1800, 5.0), np.full(600, 20.0)])
    made = air()
    found = []
    for second, wanted_degC in enumerate(wanted.tolist()):
        made.drive(100.0 + second - 0.5, wanted_degC)
        found.append(mean(made, 100.0 + second - 0.5))
    assert np.max(np.abs(np.array(found[:-1]) - ramped(wanted, 1.0, STILL)[:-1])) < 1e-9


def test_a_gradient_slows_it_down_and_never_speeds_it_up():
    slow, fast = air(), air()
    for made, rate_K_min in ((slow, 0.5), (fast, 50.0)):
        made.limit(100.0, rate_K_min, rate_K_min)
        made.drive(100.0, 80.0)
    assert mean(slow, 1300.0) == pytest.approx(20.0 + 0.5 * (20.0 - 1.0), abs=0.02)  # a minute behind the ramp
    assert mean(fast, 1300.0) == pytest.approx(20.0 + 2.0 * (20.0 - 1.0), abs=0.05)


def test_it_swings_only_while_it_works_and_what_was_read_once_does_not_change():
    made = ChamberAir(0.0, 20.0, 3, SWINGING)
    stopped = [made.at(float(second)) for second in range(900)]
    made.drive(900.0, 20.0)
    working = [made.at(float(second)) for second in range(1800, 3600)]
    assert stopped == pytest.approx([20.0] * 900)
    assert np.std(working) == pytest.approx(math.hypot(1.0 / math.sqrt(2.0), 0.08), rel=0.1)
    made.drive(0.0, 40.0)
    times = [second / 3.0 for second in range(600)]
    before = [made.at(at_s) for at_s in times]
    made.drive(200.0, -20.0)
    made.at(2000.0)
    assert [made.at(at_s) for at_s in times] == before


def test_bytes_come_one_after_the_other_and_take_their_time(closed):
    clock = Clock()
    simulated = closed(Simulated(CHAMBER, clock))
    port = os.open(simulated.port, os.O_RDWR | os.O_NOCTTY)
    began_s = clock.now_s()
    os.write(port, b"$00I\r")
    parts: list[bytes] = []
    while not b"".join(parts).endswith(b"\r"):
        assert select.select([port], [], [], 10.0)[0]
        parts.append(os.read(port, 4096))
    assert clock.now_s() - began_s >= (5 + 87) * 10 / 9600  # question and answer, ten bits a byte
    assert len(parts) > 1
    assert b"".join(parts) == b"0022.0 " + b"0022.0 0000.0 " * 4 + b"0022.0 " + b"0" * 16 + b"\r"
    os.close(port)


def test_a_fast_clock_runs_and_waits_as_fast():
    clock, real = Clock(200.0), Clock()
    began_s, first_s = real.now_s(), clock.now_s()
    clock.sleep(10.0)
    assert clock.now_s() - first_s >= 10.0
    assert real.now_s() - began_s >= 10.0 / 200.0
    assert not clock.wait(threading.Event(), 1.0)
    event = threading.Event()
    event.set()
    assert clock.wait(event, 1e6)
    with pytest.raises(ValueError, match="positive"):
        Clock(-1.0)
    assert [clock.patience_s(1.0), clock.patience_s(1000.0), real.patience_s(0.1)] == [0.5, 5.0, 0.1]
