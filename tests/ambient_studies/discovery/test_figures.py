"""The benchmark's figures against counts made by hand, and Wilson's interval against its defining equation."""

import json
import math

import pytest
from scipy.optimize import brentq

from ambient_studies.discovery.figures import (
    Outcome,
    Share,
    confident_verdicts,
    confusion,
    detection_by_size,
    false_alarms,
    large_effects,
    median_of,
    pairs_found,
    reliability,
)
from ambient_studies.discovery.report import as_json, report_of
from ambient_trainer.diagnosis.result import Cause
from ambient_trainer.report import Finding

HEAT, CASE, HAND = Cause("heat_source", "soc", "a_on"), Cause("ambient_coupling"), Cause("contact", "soc")
NONE, UNKNOWN = Cause("none"), Cause("unknown")


def outcome(true, found, size=6.0):
    return Outcome(true, size, found, set(true) == set(found), None, None, None, 1.0)


@pytest.mark.parametrize(("hits", "cases"), [(0, 20), (1, 20), (10, 20), (20, 20), (190, 200)])
def test_wilsons_ends_are_where_the_score_test_just_rejects(hits, cases):
    low, high = Share(hits, cases).ci95

    def score(p):
        return (hits / cases - p) ** 2 * cases - 1.959963984540054**2 * p * (1 - p)

    middle = hits / cases
    assert low == pytest.approx(0.0 if hits == 0 else brentq(score, 1e-12, middle - 1e-9))
    assert high == pytest.approx(1.0 if hits == cases else brentq(score, middle + 1e-9, 1 - 1e-12))


def test_the_confusion_counts_first_causes_of_single_cases():
    matrix = confusion(
        [
            outcome((HEAT,), (HEAT,)), outcome((HEAT,), (HAND, HEAT)), outcome((HEAT,), ()),
            outcome((), (UNKNOWN,)), outcome((), (NONE,)), outcome((NONE,), ()), outcome((HEAT, CASE), (CASE,)),
        ]
    )  # fmt: skip
    assert matrix.true == ("none", "heat_source")
    assert matrix.found == ("none", "contact", "heat_source", "unknown")
    assert matrix.counts.tolist() == [[2, 0, 0, 1], [1, 1, 1, 0]]


def test_detection_goes_by_size():
    cases = [outcome((HEAT,), (HEAT,), size) for size in (1.0, 1.2, 5.0)]
    cases += [outcome((HEAT,), (), 1.9), outcome((), (), 0.0), outcome((HEAT, CASE), (HEAT,), 5.5)]
    found = detection_by_size(cases, (0.0, 1.0, 2.0, 5.0, math.inf))
    assert [(each.low, each.high, each.middle) for each in found] == [(1.0, 2.0, 1.2), (5.0, math.inf, 5.0)]
    assert [(each.share.hits, each.share.cases) for each in found] == [(2, 3), (1, 1)]
    assert large_effects(cases) == Share(1, 1)


def test_unknown_is_a_false_alarm_and_none_is_not():
    assert false_alarms(
        [outcome((), (UNKNOWN,)), outcome((), (NONE,)), outcome((), ()), outcome((HEAT,), (HEAT,))]
    ) == Share(1, 3)


def test_of_two_effects_each_is_counted_in_any_order():
    pairs = pairs_found(
        [
            outcome((HEAT, CASE), (CASE, Cause("heat_source", "soc"))), outcome((HEAT, CASE), (HEAT, HAND)),
            outcome((HEAT, CASE), ()), outcome((HEAT, CASE), (HAND,)), outcome((HEAT,), (HEAT, CASE)),
        ]
    )  # fmt: skip
    assert (pairs.both, pairs.one, pairs.nothing) == (Share(1, 4), Share(2, 4), Share(1, 4))


def test_confidence_is_held_against_the_share_that_is_right():
    def verdict(sure, right, *more):
        found = (HEAT if right else HAND, *(cause for cause, _ in more))
        return Outcome((HEAT,), 6.0, found, right, None, None, None, 1.0, (sure, *(own for _, own in more)))

    cases = [verdict(0.95, True), verdict(0.97, False), verdict(1.0, True, (CASE, 0.2)), verdict(0.6, True)]
    cases += [Outcome((HEAT,), 6.0, (UNKNOWN,), False, None, None, None, 1.0, (0.0,)), outcome((), ())]
    found = [(each.low, each.high, each.share.hits, each.share.cases) for each in reliability(cases)]
    assert found == [(0.5, 0.7, 1, 1), (0.95, 1.0, 2, 3)]
    assert reliability(cases)[1].middle == pytest.approx((0.95 + 0.97 + 1.0) / 3)
    assert confident_verdicts(cases) == Share(2, 3)
    assert [right for _, _, right in cases[2].named] == [True, False]


def test_a_share_and_a_median_of_nothing_are_none():
    assert math.isnan(Share(0, 0).value)
    assert median_of([None, -3.0, 1.0, math.nan, 2.0]) == 2.0
    assert math.isnan(median_of([None]))


def test_a_machine_gets_the_counts(outcomes):
    data = json.loads(json.dumps(as_json(outcomes), allow_nan=False))
    assert data["cases"] == 400
    assert (data["false_alarms"]["hits"], data["false_alarms"]["cases"]) == (2, 60)
    assert sum(map(sum, data["confusion"]["counts"])) == 360
    assert (data["two_at_once"]["both"]["hits"], data["two_at_once"]["both"]["cases"]) == (30, 40)
    assert json.loads(json.dumps(as_json([]), allow_nan=False))["large_effects"]["share"] is None


def test_the_benchmark_is_held_against_what_is_asked(outcomes):
    def tiles(some):
        blocks = report_of(some, {}).sections[0].blocks
        return {(each.value, each.status) for each in blocks if isinstance(each, Finding)}

    assert tiles(outcomes) >= {("96.7 %", "good"), ("75.0 %", "bad")}
    assert ("0.0 %", "bad") in tiles([each for each in outcomes if len(each.true) < 2 or not each.correct])
    assert tiles([]) == set()
