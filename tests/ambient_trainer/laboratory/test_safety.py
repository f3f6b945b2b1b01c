"""What ends a run, from synthetic readings."""

import pytest

from ambient_trainer.laboratory.campaign import ChamberLimits, Safety
from ambient_trainer.laboratory.program import SafetyLimits

SAFETY = Safety(
    set_point_degC=20.0,
    chamber=ChamberLimits(low_degC=-20.0, high_degC=60.0, margin_K=3.0),
    device_high_degC={"battery_degC": 50.0, "soc_degC": 100.0},
    ambient_lost_s=120.0,
)


@pytest.fixture
def watch():
    return SafetyLimits(SAFETY, 1000.0)


@pytest.mark.parametrize(
    ("values", "parts"),
    [
        ({"chamber_degC": 62.9, "chamber_set_degC": 900.0}, None),
        ({"chamber_degC": -22.9}, None),
        ({"battery_degC": 50.0, "soc_degC": None, "usb_degC": 900.0}, None),
        ({"chamber_degC": 63.1}, ("chamber", "63.1", "60")),
        ({"chamber_degC": -23.1}, ("chamber", "-23.1", "-20")),
        ({"battery_degC": 50.1}, ("battery_degC", "50.1", "50")),
        ({"battery_degC": 20.0, "soc_degC": 101.0}, ("soc_degC", "101", "100")),
    ],
)
def test_a_limit_that_is_crossed_once_is_crossed(values, parts, watch):
    watch.check(values)
    watch.check(dict.fromkeys(values, 25.0))
    violation = watch.violation(1001.0)
    assert violation is None if parts is None else all(part in violation for part in parts)


def test_the_ambient_is_limited_and_may_not_be_lost_for_long(watch):
    assert (watch.violation(1120.0), watch.violation(1121.0) is None) == (None, False)  # no probe ever answered
    watch.check_ambient(1150.0, 62.9)
    watch.check_ambient(1200.0, None)
    assert watch.violation(1270.0) is None
    assert "121 s" in watch.violation(1271.0)
    watch.check_ambient(1272.0, 20.0)
    assert watch.violation(1273.0) is None
    watch.check_ambient(1274.0, 64.0)
    assert "64.0" in watch.violation(1274.0)
