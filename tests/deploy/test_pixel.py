"""The Pixel thermal HAL's snippet: what the HAL would refuse or misread, as far as that can be told without a Pixel."""

import json
from pathlib import Path

import pytest

DEPLOY = Path(__file__).resolve().parents[2] / "deploy"
OF_THE_DEVICE = {"skin_therm"}
"""Named by the snippet, and defined by the device's own file."""


@pytest.fixture
def sensors():
    listed = json.loads((DEPLOY / "pixel" / "thermal_info_config.json").read_text())["Sensors"]
    named = {each["Name"]: each for each in listed}
    assert len(named) == len(listed)
    return named


def test_the_estimate_is_a_sensor_where_android_publishes_it(sensors):
    published = json.loads((DEPLOY / "android" / "ambientd.json").read_text())["publish"]
    assert f"file:{sensors['ambient_est']['TempPath']}" in published, "the HAL reads integer millidegrees, by rename"
    assert sensors["ambient_est"]["Multiplier"] == 0.001
    assert "VirtualSensor" not in sensors["ambient_est"]


def test_there_are_seven_ascending_thresholds(sensors):
    for sensor in sensors.values():
        none, *thresholds = sensor["HotThreshold"]
        assert (none, len(thresholds)) == ("NAN", 6), "the first severity, none, has no threshold"
        assert thresholds == sorted(set(thresholds))
        assert sensor["PollingDelay"] >= 1000


def test_a_virtual_sensor_weighs_what_is_there(sensors):
    virtual = [each for each in sensors.values() if each.get("VirtualSensor")]
    assert virtual
    for sensor in virtual:
        assert sensor["Formula"] == "WEIGHTED_AVG"
        assert "TempPath" not in sensor
        assert set(sensor["Combination"]) <= set(sensors) | OF_THE_DEVICE
        assert "ambient_est" in sensor["Combination"]
        assert len(sensor["Coefficient"]) == len(sensor["Combination"])
        assert sum(sensor["Coefficient"]) == pytest.approx(1)
