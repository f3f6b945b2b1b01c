"""Units' runs: the nominal one is the simulated phone itself, a sensor's error is its own, a case warms and slows."""

from dataclasses import replace

import numpy as np
import pytest

from ambient_studies.unit_variation.study import CALIBRATION, CALIBRATION_DEGC, Asked, traces
from ambient_trainer.simulator.device import load_device
from ambient_trainer.simulator.fleet import nominal
from ambient_trainer.simulator.simulate import simulate

PERIOD_S = 5.0
ZONES = load_device().main_zones


@pytest.fixture(scope="module")
def unit():
    return nominal(ZONES)


def test_the_nominal_unit_logs_what_the_simulated_phone_does(unit):
    found = traces([Asked(unit, False, "2.5", 3), Asked(unit, True, "2.5", 3)], PERIOD_S)[0]
    expected = simulate("2.5", seed=3, period_s=PERIOD_S).trace
    assert found.columns.keys() == expected.columns.keys()
    for name, values in expected.columns.items():
        np.testing.assert_array_equal(found.columns[name], values)


def test_a_gain_acts_about_25_degC_and_an_offset_everywhere(unit):
    usb = next(index for index, zone in enumerate(ZONES) if zone.name == "usb")
    moved = ZONES[usb].model_copy(update={"offset_degC": 0.4, "step_degC": 1e-6, "noise_degC": 0.0})
    still = ZONES[usb].model_copy(update={"step_degC": 1e-6, "noise_degC": 0.0})
    off = replace(unit, zones=(*ZONES[:usb], moved, *ZONES[usb + 1 :]), gains={"usb": 0.02})
    on = replace(unit, zones=(*ZONES[:usb], still, *ZONES[usb + 1 :]))
    skewed, straight = traces([Asked(off, False, "3", 3), Asked(on, False, "3", 3)], PERIOD_S)
    plain = straight.columns["usb_degC"]
    np.testing.assert_allclose(skewed.columns["usb_degC"], plain + 0.4 + 0.02 * (plain - 25.0), atol=2e-6)
    for name in ("soc_degC", "display_degC", "ambient_degC"):
        np.testing.assert_array_equal(skewed.columns[name], straight.columns[name])


def test_a_case_keeps_a_phone_warmer_at_rest_and_slower_under_load(unit):
    asked = [Asked(unit, cased, name, 3) for name in ("1", "2.1") for cased in (False, True)]
    rise = [trace.columns["battery_degC"] - trace.reference for trace in traces(asked, PERIOD_S)]
    assert rise[1].mean() > rise[0].mean() + 0.03
    third = slice(len(rise[2]) // 2, 3 * len(rise[2]) // 4)
    assert rise[3][third].mean() < rise[2][third].mean() - 0.2


def test_a_calibration_is_at_rest_in_a_known_room(unit):
    [trace] = traces([Asked(unit, False, CALIBRATION, 9)], PERIOD_S)
    assert trace.time_s[-1] == pytest.approx(40 * 60 - PERIOD_S)
    assert trace.reference.mean() == pytest.approx(CALIBRATION_DEGC, abs=1.0)
    assert trace.columns["cpu_load_frac"].max() < 0.05
    halves = np.array_split(trace.columns["battery_degC"], 2)
    assert halves[0].mean() == pytest.approx(halves[1].mean(), abs=0.5)
