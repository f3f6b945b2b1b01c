"""The simulated laboratory against what the simulated phone's chamber does, and against the speed of a wire."""

from __future__ import annotations

import math
import os
import select
import threading

import numpy as np
import pytest

from ambient_trainer.laboratory.clock import FastClock, RealClock
from ambient_trainer.laboratory.instruments.chamber import Chamber
from ambient_trainer.laboratory.simulated.air import Air
from ambient_trainer.laboratory.simulated.chamber import SimulatedChamber
from ambient_trainer.simulator.chamber import ramped
from ambient_trainer.simulator.device import Chamber as Dynamics

STILL = Dynamics(heating_K_min=2.0, cooling_K_min=1.5, wobble_degC=0.0)


def air(dynamics: Dynamics, seed: int = 0) -> Air:
    made = Air(100.0, 20.0, dynamics, seed)
    made._draught = 0.0
    return made


def mean(made: Air, at_s: float) -> float:
    """Without draughts."""
    made.at(at_s)
    return made._mean_degC


def test_its_air_is_that_of_the_simulated_phones_chamber() -> None:
    wanted = np.concatenate([np.full(60, 20.0), np.full(1200, 35.0), np.full(1800, 5.0), np.full(600, 20.0)])
    made = air(STILL)
    found = []
    for second, wanted_degC in enumerate(wanted.tolist()):
        made.drive(100.0 + second - 0.5, wanted_degC)
        found.append(mean(made, 100.0 + second - 0.5))
    assert np.max(np.abs(np.array(found[:-1]) - ramped(wanted, 1.0, STILL)[:-1])) < 1e-9


def test_a_gradient_slows_it_down_and_never_speeds_it_up() -> None:
    slow, fast = air(STILL), air(STILL)
    for made, rate_K_min in ((slow, 0.5), (fast, 50.0)):
        made.limit(100.0, rate_K_min, rate_K_min)
        made.drive(100.0, 80.0)
    assert mean(slow, 1300.0) == pytest.approx(20.0 + 0.5 * (20.0 - 1.0), abs=0.02)  # a minute behind the ramp
    assert mean(fast, 1300.0) == pytest.approx(20.0 + 2.0 * (20.0 - 1.0), abs=0.05)


def test_it_swings_about_the_set_point_only_while_it_works() -> None:
    made = Air(0.0, 20.0, Dynamics(2.0, 1.5, 1.0), 3)
    stopped = [made.at(float(second)) for second in range(900)]
    made.drive(900.0, 20.0)
    working = [made.at(float(second)) for second in range(1800, 3600)]
    assert stopped == pytest.approx([20.0] * 900)
    assert np.std(working) == pytest.approx(math.hypot(1.0 / math.sqrt(2.0), 0.08), rel=0.1)


def test_stopped_it_goes_back_to_the_rooms_temperature() -> None:
    made = air(STILL)
    made.drive(100.0, 40.0)
    before = mean(made, 3000.0)
    made.drive(3000.0, None)
    assert before == pytest.approx(40.0, abs=0.01)
    assert 20.0 < mean(made, 4800.0) < 30.0
    assert mean(made, 20000.0) == pytest.approx(20.0, abs=0.01)


def test_what_was_read_once_does_not_change_any_more() -> None:
    made = Air(0.0, 20.0, Dynamics(2.0, 1.5, 1.0), 3)
    made.drive(0.0, 40.0)
    times = [second / 3.0 for second in range(600)]
    before = [made.at(at_s) for at_s in times]
    made.drive(200.0, -20.0)
    made.at(2000.0)
    assert [made.at(at_s) for at_s in times] == before


def test_answers_take_the_time_of_their_bytes(tmp_path) -> None:
    clock = RealClock()
    simulated = SimulatedChamber(clock, folder=str(tmp_path))
    chamber = Chamber(simulated.port, clock=clock)
    reading = chamber.read()
    assert reading.answered_s - reading.asked_s >= (5 + 87) * 10 / 9600  # question and answer, ten bits a byte
    chamber.close()
    simulated.close()


def test_bytes_come_one_after_the_other(tmp_path) -> None:
    simulated = SimulatedChamber(RealClock(), folder=str(tmp_path))
    port = os.open(simulated.port, os.O_RDWR | os.O_NOCTTY)
    os.write(port, b"$00I\r")
    parts: list[bytes] = []
    while not b"".join(parts).endswith(b"\r"):
        assert select.select([port], [], [], 10.0)[0]
        parts.append(os.read(port, 4096))
    assert len(parts) > 1
    assert (
        b"".join(parts) == b"0022.0 0022.0 0000.0 0022.0 0000.0 0022.0 0000.0 0022.0 0000.0 0022.0 " + b"0" * 16 + b"\r"
    )
    os.close(port)
    simulated.close()


def test_a_fast_clock_runs_and_waits_as_fast() -> None:
    clock, real = FastClock(200.0, start_s=50.0), RealClock()
    began_s = real.now_s()
    first_s = clock.now_s()
    clock.sleep(10.0)
    assert clock.now_s() - first_s >= 10.0
    assert real.now_s() - began_s >= 10.0 / 200.0
    assert not clock.wait(threading.Event(), 1.0)
    event = threading.Event()
    event.set()
    assert clock.wait(event, 1e6)
    assert first_s >= 50.0
    assert clock.wall_s(200.0) == 1.0
    assert clock.patience_s(1.0) == FastClock.LEAST_PATIENCE_S
    assert clock.patience_s(1000.0) == 5.0


@pytest.mark.parametrize("speed", [0.0, -1.0, math.nan])
def test_a_clock_goes_forward(speed) -> None:
    with pytest.raises(ValueError, match="a clock's speed is positive"):
        FastClock(speed)


def test_a_folder_of_its_own_goes_with_the_instrument() -> None:
    simulated = SimulatedChamber(FastClock(20.0))
    folder = os.path.dirname(simulated.port)
    assert os.path.islink(simulated.port)
    simulated.close()
    assert not os.path.exists(folder)
