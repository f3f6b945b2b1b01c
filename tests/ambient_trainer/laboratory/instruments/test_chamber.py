from __future__ import annotations

import math
import time
from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ambient_model.faults import Refused
from ambient_trainer.laboratory.clock import FastClock
from ambient_trainer.laboratory.instruments.chamber import Chamber
from ambient_trainer.laboratory.line import Silent, Unplugged
from ambient_trainer.laboratory.simulated.chamber import SimulatedChamber


def became(condition: Callable[[], bool]) -> None:
    """Wait until the simulated chamber has done what was said to it."""
    for _ in range(1000):
        if condition():
            return
        time.sleep(0.01)
    pytest.fail("it did not come to that")


@pytest.fixture
def heard(bench):
    """A bench of the chamber, and what is said to it."""
    made = bench("chamber")
    said: list[bytes] = []
    hear = made.simulated._hear

    def listen(data: bytes):
        said.append(data)
        return hear(data)

    made.simulated._hear = listen
    return made, said


def test_it_starts_goes_where_it_is_sent_and_stops(heard) -> None:
    bench, said = heard
    chamber = bench.driver
    assert chamber.identify() == "ASCII-2 chamber, stopped, at 21.5 degC"
    chamber.gradient(2.0, 1.5)
    chamber.set_point(-10.0)
    reading = chamber.read()
    assert (reading.set_degC, reading.actual_degC, reading.running, reading.alarm) == (-10.0, 21.5, True, None)
    assert bench.simulated.held_degC == -10.0
    chamber.stop()
    assert not chamber.read().running
    assert bench.simulated.held_degC is None
    whole = b"".join(said).split(b"\r")
    assert whole == [
        b"$00F",  # in step
        b"$00I", b"$00F",
        b"$00U 0002.0 0001.5 0000.0 0000.0",
        b"$00E -010.0 0000.0 0000.0 0000.0 0000.0 0101000000000000",
        b"$00I", b"$00F",
        b"$00E -010.0 0000.0 0000.0 0000.0 0000.0 0000000000000000",
        b"$00I", b"$00F",
        b"",
    ]  # fmt: skip


def test_other_values_and_outputs_stay_as_they_are(heard) -> None:
    bench, said = heard
    bench.simulated._put((10.0, 0.0, 3.5, 0.0, 0.0), tuple(bit == "1" for bit in "0000010100000100"))
    bench.driver.read()
    bench.driver.set_point(10.0)
    assert said[-1] == b"$00E 0010.0 0000.0 0003.5 0000.0 0000.0 0101010100000100\r"


@given(temp_degC=st.floats() | st.floats(-60.0, 200.0))
def test_nothing_outside_the_limits_is_sent(temp_degC) -> None:
    chamber = Chamber("/nowhere/port", -20.0, 60.0)
    inside = -20.0 <= temp_degC <= 60.0
    with pytest.raises(Unplugged if inside else Refused) as caught:
        chamber.set_point(temp_degC)
    if not inside:
        assert str(caught.value) == (
            f"chamber on /nowhere/port: set point: {temp_degC:g} degC is outside its limits, -20 to 60 degC; "
            "choose another, or other limits; nothing was sent"
        )


def test_what_would_round_to_outside_the_limits_is_not_sent() -> None:
    with pytest.raises(Refused):
        Chamber("/nowhere/port", -20.0, 59.97).set_point(59.96)


@pytest.mark.parametrize(
    ("low_degC", "high_degC"), [(-45.1, 60.0), (0.0, 185.1), (30.0, 20.0), (20.0, 20.0), (math.nan, 60.0)]
)
def test_limits_lie_within_what_the_chamber_can_do(low_degC, high_degC) -> None:
    with pytest.raises(Refused, match="name two, the lower first, within -45 to 185 degC"):
        Chamber("/nowhere/port", low_degC, high_degC)


@pytest.mark.parametrize("rate_K_min", [-0.1, 100.0, 0.04, math.nan, math.inf])
def test_gradients_that_cannot_be_said_are_refused(rate_K_min) -> None:
    chamber = Chamber("/nowhere/port")
    for rates, way in (((rate_K_min, 1.0), "up"), ((1.0, rate_K_min), "down")):
        with pytest.raises(Refused, match=f"gradient {way}: .*choose 0.1 to 99.9 K/min, or 0 for none; nothing was"):
            chamber.gradient(*rates)


def test_an_alarm_stops_it_until_it_is_mended_and_acknowledged(bench) -> None:
    bench = bench("chamber")
    chamber = bench.driver
    chamber.set_point(30.0)
    bench.simulated.raise_alarm(7, "overtemperature")
    reading = chamber.read()
    assert (reading.running, reading.alarm) == (False, "07 overtemperature")
    chamber.acknowledge()
    chamber.set_point(30.0)
    assert chamber.read().alarm == "07 overtemperature"
    assert bench.simulated.held_degC is None
    bench.simulated.clear_alarm()
    chamber.acknowledge()
    chamber.set_point(30.0)
    reading = chamber.read()
    assert (reading.running, reading.alarm) == (True, None)


def test_a_set_point_is_sent_to_a_chamber_that_hears_but_does_not_speak(bench) -> None:
    bench = bench("chamber")
    bench.driver.set_point(50.0)
    bench.simulated.mute()
    with pytest.raises(Silent):
        bench.driver.read()
    with pytest.raises(Silent):
        bench.driver.set_point(20.0)
    became(lambda: bench.simulated.held_degC == 20.0)
    with pytest.raises(Silent):
        bench.driver.stop()
    became(lambda: bench.simulated.held_degC is None)


def test_noise_does_not_keep_a_set_point_from_being_sent(bench) -> None:
    bench = bench("chamber")
    bench.driver.set_point(50.0)
    bench.simulated.say(b"\xff\x00")
    bench.clock.sleep(2.0)
    bench.driver.set_point(20.0)
    assert bench.simulated.held_degC == 20.0


def test_a_later_controller_is_asked_once_in_five_seconds(tmp_path) -> None:
    clock = FastClock(100.0)
    simulated = SimulatedChamber(clock, folder=str(tmp_path), pause_s=5.0)
    patient = Chamber(simulated.port, clock=clock, pause_s=5.1)
    began_s = clock.now_s()
    patient.set_point(25.0)
    first, second = patient.read(), patient.read()
    assert second.asked_s - first.asked_s >= 2 * 5.1
    assert first.asked_s - began_s >= 2 * 5.1  # behind the marker and the set point
    patient.close()
    hasty = Chamber(simulated.port, clock=clock)
    with pytest.raises(Silent):
        hasty.read()  # a state and a fault at once
    hasty.close()
    simulated.close()


def test_a_malformed_command_is_answered_by_an_empty_line(bench) -> None:
    bench = bench("chamber")
    assert bench.simulated._answer("E 0010.0") == b"\r"
    assert bench.simulated._answer("E 0190.0 0000.0 0000.0 0000.0 0000.0 0101000000000000") == b"\r"
    assert bench.simulated._answer("Z") == b"\r"
