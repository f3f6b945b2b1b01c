"""An effect is hidden in the simulated phone, and its cause, place, signal, size and onset are found.

An onset is due within two minutes of when it shows above the noise, and no later than its absence would have shown.
"""

import numpy as np
import pytest
from scipy.ndimage import uniform_filter1d

from ambient_studies.discovery.cases import CAUSES, PERIOD_S
from ambient_studies.discovery.runner import ONSET_S

pytestmark = pytest.mark.slow
"""Each takes about 20 s of a processor; the discovery benchmark draws many more."""

SEED = 1
CONFIDENT, DUE_IN_NOISE, SMOOTH_S = 0.9, 5.0, 60.0


def explained(case):
    """What to read where a test fails."""
    return f"hidden {case.run.truths}, found {[step.sentence for step in case.found.steps]}"


@pytest.mark.parametrize("cause", [cause for cause in CAUSES if cause != "thermal_mass"])
def test_an_effect_is_named_with_its_place_size_and_onset(bench, diagnosed, cause):
    case = diagnosed(SEED, cause)
    outcome = case.outcome
    assert outcome.size_in_noise >= DUE_IN_NOISE
    assert outcome.found[:1] == outcome.true, explained(case)
    assert case.outcome.magnitude_right, explained(case)
    assert case.found.verdict.gain.ci95_degC[0] > 0
    assert case.outcome.onset_right is not False or within_sight(case, bench), explained(case)


def within_sight(case, bench):
    """Whether the onset found is as near to the true one as the noise allows to see."""
    truth, found_s, time_s = case.run.truths[0], case.found.verdict.onset_s or 0.0, case.run.trace.time_s
    sensors = [f"{output.name}_degC" for output in bench.known.model.circuit.outputs]
    clean = case.run.clean.columns[truth.worst]
    felt = case.run.trace.columns[truth.worst] - clean
    if found_s < truth.onset_s:
        assert truth.cause == "sensor_lag", explained(case)
        smooth = uniform_filter1d(clean, int(SMOOTH_S / PERIOD_S))
        felt = smooth - np.interp(time_s - truth.magnitude, time_s, smooth)
    first_s, last_s = sorted((truth.onset_s, found_s))
    between = (time_s >= first_s) & (time_s < last_s) & (np.abs(time_s - found_s) > ONSET_S)
    return np.sqrt(np.mean(felt[between] ** 2)) < bench.known.noise_degC[sensors.index(truth.worst)]


def test_nothing_is_found_where_nothing_is_hidden(diagnosed):
    case = diagnosed(SEED)
    assert case.found.steps == (), explained(case)


def test_the_signal_that_drives_it_is_not_taken_for_those_that_do_not(diagnosed):
    case = diagnosed(SEED, "heat_source", location="usb", signal="charger_on")
    assert case.found.verdict_cause.signal == "charger_on", explained(case)
    assert case.outcome.correct, explained(case)
    assert case.outcome.magnitude_right, explained(case)


@pytest.mark.parametrize(
    ("cause", "given"), [("thermal_mass", {}), ("ambient_coupling", {"location": "back", "signal": "case_on"})]
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
