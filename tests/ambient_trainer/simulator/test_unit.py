"""Units are drawn within what their tolerances say, each by its own number."""

from dataclasses import replace

import numpy as np
import pytest

from ambient_trainer.simulator.device import load_device
from ambient_trainer.simulator.fleet import FleetPlan, drawn, fleet, nominal

ZONES = load_device().main_zones
MANY = 400


@pytest.fixture(scope="module")
def many():
    return [drawn(number, 1, ZONES) for number in range(1, MANY + 1)]


def test_the_nominal_unit_is_the_calibrated_phone_and_another_is_itself_whoever_else_is_drawn(many):
    unit = nominal(ZONES)
    assert (unit.number, unit.phone, unit.zones, unit.gains) == (0, load_device(), ZONES, {})
    assert drawn(7, 1, ZONES) == many[6]
    assert drawn(7, 2, ZONES) != many[6]
    some = drawn(7, 1, ZONES[3:])
    assert some.phone == many[6].phone
    assert some.zones == many[6].zones[3:]


@pytest.mark.parametrize(
    ("of", "middle", "spread"),
    [
        (lambda unit: unit.phone.conductance_W_K["battery-display"], 0.3888, 0.15),
        (lambda unit: unit.phone.nodes["battery"].capacitance_J_K, 61.02, 0.03),
        (lambda unit: unit.phone.activities["idle"].heat_W["soc"], 0.2409, 0.3),
        (lambda unit: unit.phone.activities["cpu_100"].heat_W["soc"], 9.0, 0.05),
        (lambda unit: unit.phone.convection_W_m2_K125, 11.96, 0.03),
        (lambda unit: unit.phone.battery.ohm, 0.08, 0.1),
        (lambda unit: unit.zones[3].share, 0.1648, 0.1),
        (lambda unit: unit.zones[3].lag_s, 8.0, 0.2),
    ],
)
def test_what_scatters_by_so_much_does(many, of, middle, spread):
    logs = np.log([of(each) for each in many])
    assert np.mean(logs) == pytest.approx(np.log(middle), abs=4 * spread / np.sqrt(MANY))
    assert np.std(logs) == pytest.approx(spread, rel=0.15)


def test_leakage_is_the_die_s_own_and_not_each_activity_s(many):
    unit, phone = many[0], load_device()

    def ratio(name, node):
        return unit.phone.activities[name].heat_W[node] / phone.activities[name].heat_W[node]

    standby = {ratio("idle", node) for node in ("soc", "board2")}
    assert max(standby) == pytest.approx(min(standby))
    loads = {ratio("cpu_100", "soc"), ratio("camera_4k", "camera")}
    assert max(loads) == pytest.approx(min(loads))


def test_thermistors_keep_within_their_grade_and_silicon_scatters(many):
    usb = np.array([unit.zones[3].offset_degC for unit in many])
    assert np.abs(usb).max() <= 0.02 / 0.044
    assert np.std(usb) == pytest.approx(np.sqrt(2 / 3) * 0.01 / 0.044, rel=0.1)
    assert max(abs(unit.gains["usb"]) for unit in many) <= 0.01
    assert np.std([unit.zones[0].offset_degC for unit in many]) == pytest.approx(1.0, rel=0.1)


def test_nothing_is_beyond_what_can_be_and_a_case_is_that_of_its_layers(many):
    """Conduction through 1 to 2 mm of 0.2 W/(m K) and 0.2 to 0.5 mm of air against 20 W/(m2 K)."""
    assert all(0 <= zone.share < 1 for unit in many for zone in unit.zones)
    assert all(0.8 < unit.phone.nodes["back"].emissivity <= 1.0 for unit in many)
    shares = [unit.case[0].size for unit in many]
    assert min(shares) >= 20 * (0.001 / 0.2 + 0.0002 / 0.026)
    assert max(shares) <= 20 * (0.002 / 0.2 + 0.0005 / 0.026)
    assert all(40 <= unit.case[1].size <= 64 for unit in many)


def test_what_drives_an_effect_in_one_unit_is_logged_in_every_unit():
    # half an hour longer than the scenario
    plan = FleetPlan("5", 3, period_s=60.0, minutes=410.0, hide=("heat_source:soc:1W:signal=radio_on:from=388min",))
    units = list(fleet(plan))
    bare = list(fleet(replace(plan, hide=())))
    assert all(set(each.trace.columns["radio_on"]) == {0.0, 1.0} for each in units)
    chips = [[each.trace.columns["soc_degC"] for each in some] for some in (units, bare)]
    changed = [each.name for each, one, other in zip(units, *chips) if not np.array_equal(one, other)]
    assert changed == [each.name for each in units if each.truth["hidden"]]
    assert len(changed) == 1


def test_a_case_is_put_on_the_sides_of_any_device():
    plan = FleetPlan("set_top_box", 1, period_s=60.0, minutes=20.0, cased=1.0, device="set_top_box")
    assert [each.case for each in fleet(plan)] == ["on"]
