"""An effect is hidden in the simulated phone, and its cause, place, signal, size and onset are found."""

import pytest

from ambient_studies.discovery.cases import CAUSES

pytestmark = pytest.mark.slow
"""Each takes about 20 s of a processor; the discovery benchmark draws many more."""

SEED = 1
CONFIDENT, DUE_IN_NOISE, DUE_S = 0.9, 5.0, 300.0


def explained(case):
    """What to read where a test fails."""
    truths = [
        f"{each.cause} {each.location} {each.signal} {each.onset_s} {each.magnitude:.4g}" for each in case.run.truths
    ]
    rivals = [str(each) for step in case.found.steps[:1] for each in step.indistinguishable_from]
    return f"hidden {truths}, found {[step.sentence for step in case.found.steps]}, rivals {rivals}"


@pytest.mark.parametrize("cause", [cause for cause in CAUSES if cause != "thermal_mass"])
def test_an_effect_is_named_with_its_place_size_and_onset(diagnosed, cause):
    case = diagnosed(SEED, cause)
    outcome = case.outcome
    assert outcome.size_in_noise >= DUE_IN_NOISE
    assert outcome.found[:1] == outcome.true, explained(case)
    assert case.outcome.magnitude_right, explained(case)
    assert case.found.verdict.gain.ci95_degC[0] > 0
    # when a drift began shows only once it has come to more than the noise
    assert cause == "sensor_drift" or abs(case.outcome.onset_error_s or 0.0) < DUE_S, explained(case)


def test_nothing_is_found_where_nothing_is_hidden(diagnosed):
    case = diagnosed(SEED)
    assert case.found.steps == (), explained(case)


def test_the_signal_that_drives_it_is_not_taken_for_those_that_do_not(diagnosed):
    case = diagnosed(SEED, "heat_source", location="usb", signal="charger_on")
    assert case.found.verdict_cause.signal == "charger_on", explained(case)
    assert case.outcome.correct, explained(case)
    assert case.outcome.magnitude_right, explained(case)


@pytest.mark.parametrize(
    ("cause", "given"),
    [("thermal_mass", {}), ("ambient_coupling", {"location": "back", "signal": "case_on"})],
)
def test_no_name_is_confident_for_what_is_on_the_back_which_no_sensor_sees(diagnosed, cause, given):
    """A mass is taken for something cold at the board before it, a case for one on the display as well."""
    case = diagnosed(SEED, cause, **given)
    assert case.outcome.size_in_noise >= DUE_IN_NOISE
    assert case.outcome.correct or case.found.verdict.confidence < CONFIDENT, explained(case)
    assert case.found.verdict_cause.signal == given.get("signal"), explained(case)


def test_two_at_once_are_both_named(diagnosed):
    case = diagnosed(SEED, "heat_source", "clock_offset")
    assert case.outcome.correct, explained(case)
    assert all(step.gain.ci95_degC[0] > 0 for step in case.found.steps)
