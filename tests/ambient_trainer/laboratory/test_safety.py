"""What ends a run, told with numbers made up."""

import pytest

from ambient_trainer.laboratory.campaign import ChamberLimits, Safety
from ambient_trainer.laboratory.safety import SafetyLimits

SAFETY = Safety(
    set_point_degC=20.0,
    chamber=ChamberLimits(low_degC=-20.0, high_degC=60.0, margin_K=3.0),
    device_high_degC={"battery_degC": 50.0, "soc_degC": 100.0},
    ambient_lost_s=120.0,
)


@pytest.fixture
def watch():
    return SafetyLimits(SAFETY, 1000.0)


def test_nothing_is_wrong(watch):
    watch.check({"chamber_degC": 62.9, "chamber_set_degC": 900.0})
    watch.check({"chamber_degC": -22.9})
    watch.check({"battery_degC": 50.0, "soc_degC": None, "usb_degC": 900.0})
    watch.check_ambient(1100.0, 62.9)
    assert watch.violation(1219.0) is None


@pytest.mark.parametrize(
    ("values", "verdict"),
    [
        ({"chamber_degC": 63.1}, "chamber: 63.1 degC is above the limit of 60 degC"),
        ({"chamber_degC": -23.1}, "chamber: -23.1 degC is below the limit of -20 degC"),
        ({"battery_degC": 50.1}, "device: battery_degC is 50.1, above its limit of 50 degC"),
        ({"battery_degC": 20.0, "soc_degC": 101.0}, "device: soc_degC is 101, above its limit of 100 degC"),
    ],
)
def test_a_limit_that_is_crossed_once_is_crossed(values, verdict, watch):
    watch.check(values)
    watch.check(dict.fromkeys(values, 25.0))
    assert watch.violation(1001.0) == verdict


def test_the_probes_watch_the_chamber_too(watch):
    watch.check_ambient(1001.0, 64.0)
    assert watch.violation(1001.0) == "ambient: 64.0 degC is above the limit of 60 degC"


def test_probes_that_are_lost(watch):
    watch.check_ambient(1050.0, 20.0)
    watch.check_ambient(1100.0, None)
    assert watch.violation(1170.0) is None
    assert watch.violation(1171.0) == "ambient: no probe answered for 121 s"
    watch.check_ambient(1172.0, 20.0)
    assert watch.violation(1173.0) is None


def test_probes_that_never_answered(watch):
    assert watch.violation(1120.0) is None
    assert watch.violation(1121.0) is not None
