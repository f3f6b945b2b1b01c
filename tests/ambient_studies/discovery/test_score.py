"""What counts as found, and the benchmark's figures against counts made by hand and scipy's interval."""

import json
import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import binomtest

from ambient_studies.discovery.figures import Outcome, Share, confusion, detection_by_size, reliability, shares_of
from ambient_studies.discovery.report import as_json
from ambient_studies.discovery.runner import place_in, score
from ambient_trainer.circuits.schema import load_circuit
from ambient_trainer.diagnosis.result import UNKNOWN, Cause, Gain, Magnitude, Step
from ambient_trainer.simulator.device import load_device
from ambient_trainer.simulator.simulate import Truth

from .conftest import synthetic_outcomes

PHONE = load_circuit("phone")
TIME_S = 5.0 + 10.0 * np.arange(100)
HEAT = Truth("heat_source", "board2", "battery", "charger_on", 600.0, None, 0.8, "W")
BIAS = Truth("sensor_bias", "battery", "battery", None, 500.0, 900.0, 2.0, "degC")
LAW = Truth("convection_law", None, None, None, None, None, 0.4, "1")
PATH = Truth("path", "usb-flash", "usb-flash", None, 500.0, None, 0.1, "W/K")
FOUND_HEAT = Cause("heat_source", "board2", "charger_on")
FOUND_BIAS = Cause("sensor_bias", "battery")


def step(cause, onset_s=None, value=1.0, unit="W", ci95=(0.0, 0.0), gain=(0.1, 0.2)):
    magnitude = Magnitude(value, unit, "how much", ci95)
    return Step(cause, onset_s, None, magnitude, 1.0, Gain(1.0, 0.5, gain, 0.0), (), "said", {}, np.zeros((1, 100)))


def scored(truths, *steps):
    return score(truths, 6.0, SimpleNamespace(time_s=TIME_S, steps=steps), PHONE, load_device(), 1.5)


def test_one_effect_is_named_by_the_first_step():
    found = scored([HEAT], step(FOUND_HEAT, gain=(0.3, 0.4)), step(FOUND_BIAS))
    assert found.correct
    assert (found.true, found.found) == ((FOUND_HEAT,), (FOUND_HEAT, FOUND_BIAS))
    assert (found.gain_ci, found.seconds, found.size_in_noise) == ((0.3, 0.4), 1.5, 6.0)
    late = scored([HEAT], step(FOUND_BIAS), step(FOUND_HEAT))
    assert not late.correct
    assert late.magnitude_error_frac is not None


@pytest.mark.parametrize(
    "cause",
    [
        Cause("heat_source", "board2"),
        Cause("heat_source", "board2", "radio_on"),
        Cause("heat_source", "board2", "d(charger_on)/dt"),
        Cause("heat_source", "board2", "charger_on^2*battery_frac"),
        Cause("heat_source", "usb", "charger_on"),
        Cause("contact", "board2", "charger_on"),
        Cause(UNKNOWN),
    ],
)
def test_cause_location_and_signal_have_to_agree(cause):
    found = scored([HEAT], step(cause))
    assert not found.correct
    assert (found.magnitude_error_frac, found.magnitude_right, found.onset_right) == (None, None, None)


@pytest.mark.parametrize(
    ("truths", "found", "correct"),
    [
        ([HEAT], [Cause("heat_source", "board2", "charger_on^2")], True),
        ([PATH], [Cause("path", "flash-usb")], True),
        ([], [], True),
        ([], [Cause(UNKNOWN)], False),
        ([BIAS], [], False),
        ([HEAT, BIAS], [FOUND_BIAS, FOUND_HEAT], True),
        ([HEAT, BIAS], [FOUND_BIAS, Cause("contact", "cell"), FOUND_HEAT], True),
        ([HEAT, BIAS], [FOUND_HEAT, Cause("sensor_bias", "usb")], False),
    ],
)
def test_of_several_all_have_to_be_there_in_any_order(truths, found, correct):
    assert scored(truths, *map(step, found)).correct is correct
    assert scored([]).gain_ci is None


@pytest.mark.parametrize(("found_s", "right"), [(380.0, True), (620.0, True), (379.0, False), (621.0, False)])
def test_an_onset_may_be_off_by_two_minutes(found_s, right):
    found = scored([BIAS], step(FOUND_BIAS, found_s, 2.0, "degC"))
    assert (found.onset_error_s, found.onset_right) == (found_s - 500.0, right)


def test_since_ever_is_since_the_trace_began():
    assert scored([LAW], step(Cause("convection_law"))).onset_error_s is None
    assert scored([LAW], step(Cause("convection_law"), 55.0)).onset_error_s == 50.0
    assert scored([BIAS], step(FOUND_BIAS)).onset_error_s == -495.0
    # a signal tells itself when it is on
    assert scored([HEAT], step(FOUND_HEAT)).onset_error_s is None


@pytest.mark.parametrize(
    ("true", "value", "ci95", "unit", "error", "right"),
    [
        (2.0, 2.5, (2.4, 2.6), "degC", 0.25, True),
        (2.0, 1.49, (1.4, 1.6), "degC", -0.255, False),
        (2.0, 3.0, (1.9, 4.1), "degC", 0.5, True),
        (2.0, -2.0, (-2.1, -1.9), "degC", -2.0, False),
        (-2.0, -1.0, (0.0, 0.0), "degC", 0.5, False),  # by its size
        (2.0, 2.0, (1.9, 2.1), "K/s", None, None),
        (2.0, float("nan"), (1.9, 2.1), "degC", None, None),
    ],
)
def test_a_magnitude_may_be_off_by_a_quarter_or_by_its_interval(true, value, ci95, unit, error, right):
    found = scored([replace(BIAS, magnitude=true)], step(FOUND_BIAS, 500.0, value, unit, ci95, (0.1, float("inf"))))
    assert (found.magnitude_error_frac, found.magnitude_right) == (pytest.approx(error), right)
    assert (found.correct, found.gain_ci) == (True, None)


def test_places_by_the_circuits_names():
    named = {node: place_in(PHONE, node, load_device()) for node in load_device().nodes}
    others = {node: name for node, name in named.items() if name != node}
    assert others == {"battery": "cell", "back": "case", "frame": "case"}
    places = [place_in(load_circuit("model2_ss"), node, load_device()) for node in ("board2", "battery", "usb", "soc")]
    assert places == ["battery", "battery", "usb", "soc"]


DIE, CASE, HAND = Cause("heat_source", "soc", "a_on"), Cause("ambient_coupling"), Cause("contact", "soc")
NONE, UNKNOWN = Cause("none"), Cause("unknown")


def outcome(true, found, size=6.0):
    return Outcome(true, size, found, set(true) == set(found), None, None, None, 1.0)


@pytest.mark.parametrize(("hits", "cases"), [(0, 20), (1, 20), (10, 20), (20, 20), (190, 200)])
def test_the_interval_of_a_share_is_wilsons(hits, cases):
    expected = binomtest(hits, cases).proportion_ci(method="wilson")
    assert Share(hits, cases).ci95 == pytest.approx((expected.low, expected.high))


def test_the_confusion_counts_first_causes_of_single_cases():
    matrix = confusion(
        [
            outcome((DIE,), (DIE,)), outcome((DIE,), (HAND, DIE)), outcome((DIE,), ()),
            outcome((), (UNKNOWN,)), outcome((), (NONE,)), outcome((NONE,), ()), outcome((DIE, CASE), (CASE,)),
        ]
    )  # fmt: skip
    assert [*matrix.index] == ["none", "heat_source"]
    assert [*matrix] == ["none", "contact", "heat_source", "unknown"]
    assert matrix.to_numpy().tolist() == [[2, 0, 0, 1], [1, 1, 1, 0]]


def test_detection_goes_by_size():
    cases = [outcome((DIE,), (DIE,), size) for size in (1.0, 1.2, 5.0)]
    cases += [outcome((DIE,), (), 1.9), outcome((), (), 0.0), outcome((DIE, CASE), (DIE,), 5.5)]
    found = detection_by_size(cases, (0.0, 1.0, 2.0, 5.0, math.inf))
    assert [(each.low, each.high, each.middle) for each in found] == [(1.0, 2.0, 1.2), (5.0, math.inf, 5.0)]
    assert [(each.share.hits, each.share.cases) for each in found] == [(2, 3), (1, 1)]
    assert shares_of(cases)["large_effects"] == Share(1, 1)


def test_unknown_is_a_false_alarm_and_none_is_not():
    cases = [outcome((), (UNKNOWN,)), outcome((), (NONE,)), outcome((), ()), outcome((DIE,), (DIE,))]
    assert shares_of(cases)["false_alarms"] == Share(1, 3)


def test_of_two_effects_each_is_counted_in_any_order():
    pairs = shares_of(
        [
            outcome((DIE, CASE), (CASE, Cause("heat_source", "soc"))), outcome((DIE, CASE), (DIE, HAND)),
            outcome((DIE, CASE), ()), outcome((DIE, CASE), (HAND,)), outcome((DIE,), (DIE, CASE)),
        ]
    )  # fmt: skip
    assert (pairs["both"], pairs["at_least_one"], pairs["nothing"]) == (Share(1, 4), Share(2, 4), Share(1, 4))


def test_confidence_is_held_against_the_share_that_is_right():
    def verdict(sure, right, *more):
        found = (DIE if right else HAND, *(cause for cause, _ in more))
        return Outcome((DIE,), 6.0, found, right, None, None, None, 1.0, (sure, *(own for _, own in more)))

    cases = [verdict(0.95, True), verdict(0.97, False), verdict(1.0, True, (CASE, 0.2)), verdict(0.6, True)]
    cases += [Outcome((DIE,), 6.0, (UNKNOWN,), False, None, None, None, 1.0, (0.0,)), outcome((), ())]
    found = [(each.low, each.high, each.share.hits, each.share.cases) for each in reliability(cases)]
    assert found == [(0.5, 0.7, 1, 1), (0.95, 1.0, 2, 3)]
    assert reliability(cases)[1].middle == pytest.approx((0.95 + 0.97 + 1.0) / 3)
    assert shares_of(cases)["confident_verdicts"] == Share(2, 3)
    assert [right for _, _, right in cases[2].named] == [True, False]


def test_a_machine_gets_the_counts():
    data = json.loads(json.dumps(as_json(synthetic_outcomes()), allow_nan=False))
    assert data["cases"] == 400
    assert (data["false_alarms"]["hits"], data["false_alarms"]["cases"]) == (2, 60)
    assert sum(map(sum, data["confusion"]["counts"])) == 360
    assert (data["two_at_once"]["both"]["hits"], data["two_at_once"]["both"]["cases"]) == (30, 40)
    assert json.loads(json.dumps(as_json([]), allow_nan=False))["large_effects"]["share"] is None
