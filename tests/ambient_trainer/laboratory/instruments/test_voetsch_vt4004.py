import math
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ambient_model.faults import Refused
from ambient_trainer.laboratory.instruments import ChamberLimits, settings
from ambient_trainer.laboratory.instruments.voetsch_vt4004 import Driver, Simulated
from ambient_trainer.laboratory.messages import Clock, Disconnected, NoResponse
from refusals import refused


def chamber(low_degC: float = -20.0, high_degC: float = 60.0) -> Driver:
    limits = ChamberLimits(low_degC=low_degC, high_degC=high_degC)
    return Driver(settings("voetsch-vt4004", port="/nowhere/port"), Clock(), limits)


@given(temp_degC=st.floats() | st.floats(-60.0, 200.0))
def test_nothing_outside_the_limits_is_sent(temp_degC):
    inside = -20.0 <= temp_degC <= 60.0
    with pytest.raises(Disconnected if inside else Refused) as caught:
        chamber().set_point(temp_degC)
    if not inside:
        for part in ("chamber", "set point", f"{temp_degC:g}", "-20 to 60"):
            assert part in str(caught.value)
    refused(chamber(high_degC=59.97).set_point, 59.96)  # it would be rounded to outside


@pytest.mark.parametrize("rate_K_min", [-0.1, 100.0, 0.04, math.nan, math.inf])
def test_gradients_that_the_protocol_has_not_are_refused(rate_K_min):
    assert re.search(r"gradient.*0\.1 to 99\.9", str(refused(chamber().gradient, rate_K_min)))


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
