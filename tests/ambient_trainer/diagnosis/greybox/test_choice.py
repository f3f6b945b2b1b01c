"""Which of several trials is taken."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from ambient_trainer.diagnosis.diagnose import diagnose
from ambient_trainer.diagnosis.greybox.choice import choose
from ambient_trainer.diagnosis.greybox.expression import Expression
from ambient_trainer.diagnosis.greybox.mechanisms.coupling import Coupling
from ambient_trainer.diagnosis.greybox.mechanisms.heat import Heat
from ambient_trainer.diagnosis.greybox.mechanisms.sensor import Bias, Clock, ReferenceBias
from ambient_trainer.diagnosis.greybox.model import Number

SENSORS = ("board", "skin")
FOLDS = 5


def fitted(held_out_degC, *left_degC):
    """What a fit leaves at each sensor."""
    left, outputs = np.outer(left_degC, np.ones(4)), [SimpleNamespace(name=each, states=None) for each in SENSORS]
    folds = np.full(FOLDS, held_out_degC**2)
    return SimpleNamespace(
        records=(SimpleNamespace(known_good=False),),
        residual_degC=lambda _: left,
        model=SimpleNamespace(circuit=SimpleNamespace(outputs=outputs)),
        held_out_rmse_degC=held_out_degC,
        held_out_stretches=folds,
        held_out=folds,
    )


def trial(kind, places, *rest):
    mechanism = kind(places, tuple(Number(each, "1", 1.0) for each in places))
    return SimpleNamespace(
        mechanism=mechanism, fitted=fitted(*rest), rmse_degC=rest[0], at_bounds=False, identified=True, permanent=True
    )


def test_one_sensor_is_blamed_where_offsets_of_all_gain_more_but_explain_little_of_another():
    """The board reads what no circuit foretells, and counts little for it; it is the skin that is 4 K off."""
    before = fitted(4.0, 6.0, 4.0)
    every, one = trial(Bias, SENSORS, 1.1, 5.5, 0.4), trial(Bias, ("skin",), 1.3, 6.0, 0.4)
    heat = trial(Heat, ("skin",), 3.8, 6.0, 3.8)
    assert choose(before, [every, one, heat], 0.0) is one


def with_a_window(place, step_degC, known_good):
    """What is left without and with heat there from 100 s on, where the board reads in steps."""
    read = np.round(np.linspace(1.0, 4.0, 300) / step_degC) * step_degC
    record = SimpleNamespace(sensors=np.array([read, np.linspace(0.0, 9.0, 300)]), known_good=known_good)
    before, window = fitted(1.0, 1.0, 1.0), trial(Heat, (place,), 0.2, 0.2, 0.2)
    before.records = window.fitted.records = (record,)
    window.mechanism, window.permanent = replace(window.mechanism, onset_s=100.0), False
    return before, window


@pytest.mark.parametrize(("step_degC", "place"), [(0.1, "board"), (1.0, "board"), (1.0, "skin")])
def test_a_step_of_the_resolution_is_no_window_of_heat_there(step_degC, place):
    """A measured battery that reads whole degrees went from 1 to 2: heat for six seconds seemed to do that."""
    before, window = with_a_window(place, step_degC, known_good=True)
    assert (choose(before, [window], 0.0) is window) == (step_degC < 1.0 or place == "skin")


@pytest.mark.parametrize("known_good", [True, False])
def test_what_begins_beside_known_good_records_lasts_only_where_that_does_about_as_well(known_good):
    before, window = with_a_window("board", 0.1, known_good)
    always = trial(Heat, ("board",), 0.22, 0.22, 0.22)
    assert choose(before, [window, always], 0.0) is (window if known_good else always)


def test_a_heater_that_was_turned_up_once_acts_in_the_place_of_a_window():
    """A measured flow heater, seen by a sensor behind a pipe: no fold foretells its only switch, stretches show it."""
    before, window = with_a_window("board", 0.1, known_good=False)
    record = before.records[0]
    record.time_s, record.samples, record.period_s = np.arange(300.0), 300, 1.0
    record.signals = {"heater_frac": (record.time_s >= 95).astype(float)}
    heater = trial(Heat, ("board",), 0.6, 0.6, 0.6)
    heater.mechanism = replace(heater.mechanism, driver=Expression("heater_frac"))
    heater.fitted.held_out_stretches, heater.fitted.records = np.full(FOLDS, 0.3**2), before.records
    assert choose(before, [window, heater], 0.0) is heater


@pytest.mark.parametrize("known_good", [True, False])
@pytest.mark.parametrize("fault", [trial(Clock, (), 2.0, 2.0, 2.0), trial(Bias, ("skin",), 2.0, 4.0, 2.4)])
def test_an_instrument_is_a_likelier_cause_where_known_good_records_show_the_bodies(known_good, fault):
    """Physics leaves a fifth more; of the error at the sensor three fifths are left."""
    before, heat = fitted(4.0, 4.0, 4.0), trial(Heat, ("skin",), 2.4, 2.4, 2.4)
    before.records = (SimpleNamespace(known_good=known_good),)
    assert choose(before, [fault, heat], 0.0) is (fault if known_good else heat)
    assert (choose(before, [fault], 0.0) is fault) == (known_good or not fault.mechanism.places)


@pytest.mark.parametrize(
    ("left_degC", "driver", "named"), [(1.3, "sun_W_m2", True), (1.7, "sun_W_m2", False), (1.3, None, False)]
)
def test_the_sun_goes_before_an_offset_of_the_reference(left_degC, driver, named):
    """A measured lake is warmer than the air; which warms it on the average both say."""
    offset, sun = trial(ReferenceBias, ("ambient",), 1.0, 1.0, 1.0), trial(Heat, SENSORS, *[left_degC] * 3)
    sun.mechanism = replace(sun.mechanism, driver=driver and Expression(driver))
    assert choose(fitted(4.0, 4.0, 4.0), [offset, sun], 0.0) is (sun if named else offset)


def test_a_window_that_is_no_finding_keeps_no_clock_away():
    before, window = with_a_window("board", 1.0, known_good=False)
    clock = trial(Clock, (), 0.2, 0.2, 0.2)
    assert choose(before, [window, clock], 0.0) is clock


@pytest.mark.parametrize(("kind", "driver"), [(Heat, "flow_m3_s > 0.1"), (Coupling, "rh_frac")])
def test_a_flow_stands_for_what_it_brings_and_what_warms_dries(kind, driver):
    assert [kind(("board",), (), Expression(each)).ambiguous for each in (driver, "wind_m_s")] == [True, False]


@pytest.mark.parametrize("drift_close", [True, False])
def test_an_offset_that_leaps_is_no_heat_though_more_has_changed(drift_close, circuit, simulated, seed):
    """Since known-good records the wind has begun to cool, which alone keeps heat near the error that is left."""
    seed = 2022 if drift_close else seed
    draw, heated = np.random.default_rng(seed), {"heat_W": lambda now, _: 0.8 * now["current_A"]}
    good = simulated(seed, **heated)
    changed = simulated(seed + 1, **heated, conductance_W_K=lambda now, _: 0.4 + 0.02 * now["wind_m_s"])
    begins, offset_K = int(draw.integers(300, 900)), draw.choice([-1, 1]) * draw.uniform(0.5, 0.8)
    read = changed.columns["board_degC"] + offset_K * (np.arange(len(changed.time_s)) >= begins)
    steps = diagnose(circuit, [replace(changed, columns={**changed.columns, "board_degC": read})], [good]).steps
    step = next(each for each in steps if each.cause.name == "sensor_bias")
    assert step.magnitude.value == pytest.approx(offset_K, abs=0.03), seed
    assert (step.confidence > 0.5, step.indistinguishable_from) == (True, ()), seed
