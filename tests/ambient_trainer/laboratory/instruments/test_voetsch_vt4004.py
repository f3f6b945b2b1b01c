import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ambient_model.faults import Refused
from ambient_trainer.laboratory.instruments import AIR, RUNNING, SET_POINT, ChamberLimits, settings
from ambient_trainer.laboratory.instruments.voetsch_vt4004 import Driver, Simulated
from ambient_trainer.laboratory.messages import Clock, Disconnected, NoResponse
from breaking import mute, send


@pytest.fixture
def recorded(bench):
    """A bench of the chamber, and what it receives."""
    made = bench("chamber")
    received: list[bytes] = []
    respond = made.simulated._respond
    made.simulated._respond = lambda data: (received.append(data), respond(data))[1]
    return made, received


def test_it_starts_goes_to_its_set_point_and_stops(recorded):
    bench, received = recorded
    chamber = bench.driver
    assert chamber.identify() == "ASCII-2 chamber, stopped, at 21.5 degC"
    chamber.gradient(2.0)
    chamber.set_point(-10.0)
    reading = chamber.read()
    assert (dict(reading.values), reading.note) == ({SET_POINT: -10.0, AIR: 21.5, RUNNING: 1.0}, None)
    assert bench.simulated.held_degC == -10.0
    chamber.stop()
    assert not chamber.read().values[RUNNING]
    assert bench.simulated.held_degC is None
    assert b"".join(received).split(b"\r") == [
        b"$00F",  # synchronises
        b"$00?", b"$00I", b"$00I", b"$00F",  # the layout, which it does not know, and twice
        b"$00U 0002.0 0002.0 0000.0 0000.0",
        b"$00E -010.0 0000.0 0000.0 0000.0 0000.0 0101000000000000",
        b"$00I", b"$00F",
        b"$00E -010.0 0000.0 0000.0 0000.0 0000.0 0000000000000000",
        b"$00I", b"$00F",
        b"",
    ]  # fmt: skip


def chamber(low_degC: float = -20.0, high_degC: float = 60.0) -> Driver:
    port = "/nowhere/port"
    return Driver(settings("voetsch-vt4004", port=port), Clock(), ChamberLimits(low_degC=low_degC, high_degC=high_degC))


@given(temp_degC=st.floats() | st.floats(-60.0, 200.0))
def test_nothing_outside_the_limits_is_sent(temp_degC):
    inside = -20.0 <= temp_degC <= 60.0
    with pytest.raises(Disconnected if inside else Refused) as caught:
        chamber().set_point(temp_degC)
    if not inside:
        for part in ("chamber", "set point", f"{temp_degC:g}", "-20 to 60"):
            assert part in str(caught.value)


def test_a_set_point_that_would_round_to_outside_the_limits_is_refused():
    with pytest.raises(Refused):
        chamber(high_degC=59.97).set_point(59.96)


@pytest.mark.parametrize("rate_K_min", [-0.1, 100.0, 0.04, math.nan, math.inf])
def test_gradients_that_the_protocol_has_not_are_refused(rate_K_min):
    with pytest.raises(Refused, match=r"gradient.*0\.1 to 99\.9"):
        chamber().gradient(rate_K_min)


def test_a_set_point_is_sent_to_a_chamber_that_does_not_answer(bench, until):
    bench = bench("chamber")
    bench.driver.set_point(50.0)
    mute(bench.simulated)
    with pytest.raises(NoResponse):
        bench.driver.read()
    with pytest.raises(NoResponse):
        bench.driver.set_point(20.0)
    until(lambda: bench.simulated.held_degC == 20.0)
    with pytest.raises(NoResponse):
        bench.driver.stop()
    until(lambda: bench.simulated.held_degC is None)


def test_noise_does_not_keep_a_set_point_from_being_sent(bench):
    bench = bench("chamber")
    bench.driver.set_point(50.0)
    send(bench.simulated, b"\xff\x00")
    bench.clock.sleep(2.0)
    bench.driver.set_point(20.0)
    assert bench.simulated.held_degC == 20.0


def test_a_later_controller_is_asked_once_in_five_seconds(driver_at, closed):
    clock = Clock(100.0)
    simulated = closed(Simulated(settings("voetsch-vt4004", port="", pause_s=5.0), clock))
    patient = driver_at("chamber", simulated.port, clock, pause_s=8.0)
    began_s = clock.now_s()
    patient.set_point(25.0)
    first, second = patient.read(), patient.read()
    assert second.asked_s - first.asked_s >= 2 * 8.0
    assert first.asked_s - began_s >= 2 * 8.0  # after the synchronisation and the set point
    patient.close()
    hasty = driver_at("chamber", simulated.port, clock)
    with pytest.raises(NoResponse):
        hasty.read()  # a state and a fault at once
