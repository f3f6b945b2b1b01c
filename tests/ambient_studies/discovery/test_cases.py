"""Cases come from a seed and a number alone, hold what they promise, and tell nobody what they hide."""

from collections import Counter
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest

from ambient_studies.discovery.cases import CAUSES, Case, baselines, draw_cases, simulated
from ambient_trainer.simulator.hidden import Hidden, run_faults
from ambient_trainer.simulator.scenario import load_scenario
from ambient_trainer.simulator.signals import SIGNALS
from ambient_trainer.simulator.simulate import simulate_many

CASES = draw_cases(7, 200)


def test_a_seed_and_a_number_make_a_case():
    assert draw_cases(7, 40) == CASES[:40]
    assert not set(draw_cases(8, 50)) & set(CASES)


def test_the_mix():
    assert Counter(len(case.hidden) for case in CASES) == {0: 30, 1: 130, 2: 40}
    assert Counter(len(case.hidden) for case in CASES[:20]) == {0: 3, 1: 13, 2: 4}
    causes = Counter(case.hidden[0].cause for case in CASES if len(case.hidden) == 1)
    assert (set(causes), max(causes.values()) - min(causes.values()) <= 1) == (set(CAUSES), True)


def test_two_effects_differ_in_cause_and_place_and_can_go_together():
    pairs = [case.hidden for case in CASES if len(case.hidden) == 2]
    for one, other in pairs:
        assert one.cause != other.cause
        assert not set((one.location or "all").split("-")) & set((other.location or "all").split("-"))
        # the battery's sensor sits at the charging electronics
        assert {one.location, other.location} != {"battery", "board2"}
        assert list(run_faults((one, other), load_scenario("5").duration_s)) == []
    met = {frozenset((one.cause, other.cause)) for one, other in pairs}
    assert len(met) > len(list(combinations(CAUSES, 2))) / 3


def test_decoys_drive_nothing():
    for case in CASES:
        assert 2 <= len(case.decoys) <= 4
        assert set(case.decoys) <= set(SIGNALS) - {effect.signal for effect in case.hidden}
    assert {decoy for case in CASES for decoy in case.decoys} == set(SIGNALS)


def test_another_device_has_its_own_scenario_and_places():
    drawn = draw_cases(7, 40, "set_top_box")
    bodies = {each.location for case in drawn for each in case.hidden if each.cause == "thermal_mass"}
    assert ({case.scenario for case in drawn}, bodies) == ({"set_top_box"}, {"board", "casing"})


def test_no_run_is_a_baselines_or_anothers():
    seeds = [case.seed for case in CASES]
    assert len(set(seeds)) == len(seeds)
    one, other = baselines(7, scenarios=("2.1", "2.1"))
    assert not np.array_equal(one.columns["usb_degC"], other.columns["usb_degC"])
    assert (one.columns.keys(), set(SIGNALS) & set(one.columns)) == (other.columns.keys(), set())


def test_a_trace_has_its_own_signals_and_is_that_of_its_run_and_called_what_it_would_be_without():
    heated = Hidden("heat_source", "usb", "radio_on", 0.0, None, 0.5)
    plain = Case(0, 5, (), ("wifi_on", "wind_m_s"), "2.1")
    runs = simulated([plain, replace(plain, hidden=(heated,), decoys=("gps_on",))])
    logged = [{name for name in run.trace.columns if name in SIGNALS} for run in runs]
    assert logged == [{"wifi_on", "wind_m_s"}, {"radio_on", "gps_on"}]
    assert runs[1].clean.columns.keys() == runs[1].trace.columns.keys()
    (alone,) = simulate_many([("2.1", 5, ())], 5.0)
    for name, values in alone.trace.columns.items():
        np.testing.assert_array_equal(runs[0].trace.columns[name], values)
    changed = runs[1].trace.columns["usb_degC"] - alone.trace.columns["usb_degC"]
    assert runs[1].truths[0].size_degC == pytest.approx(
        np.sqrt(np.mean(changed[runs[1].trace.columns["radio_on"] > 0] ** 2)), rel=0.1
    )
    assert [(run.trace.path, run.trace.notes) for run in runs] == 2 * [(alone.trace.path, alone.trace.notes)]
