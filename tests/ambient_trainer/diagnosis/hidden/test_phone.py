"""An effect is hidden in the simulated phone, and its cause, place, signal, size and onset are found.

The circuit was trained by known-good runs of other seeds. An onset is due within two minutes of when it could be seen:
not before the effect shows above the noise, and no later than when its absence would have shown.
"""

import numpy as np
import pytest
from scipy.ndimage import uniform_filter1d

from ambient_studies.discovery.cases import CAUSES, PERIOD_S
from ambient_studies.discovery.runner import ONSET_S

pytestmark = pytest.mark.slow
"""Each takes about 20 s of a processor; the discovery benchmark draws many more."""

DUE_IN_NOISE = 5.0
_SMOOTH_S = 60.0


SEED = 1
CONFIDENT = 0.9


def explained(case):
    """What to read where a test fails."""
    truths = [
        f"{each.cause} {each.location} {each.signal} {each.onset_s} {each.magnitude:.4g}" for each in case.run.truths
    ]
    rivals = [str(each) for step in case.found.steps[:1] for each in step.indistinguishable_from]
    return f"hidden {truths}, found {[step.sentence for step in case.found.steps]}, rivals {rivals}"


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
    truth, found_s = case.run.truths[0], case.found.verdict.onset_s
    sensors = [output.name for output in bench.known.model.circuit.outputs]
    noise_degC = bench.known.noise_degC[sensors.index(truth.worst.removesuffix("_degC"))]
    time_s, clean = case.run.trace.time_s, case.run.clean.columns[truth.worst]
    if found_s is None:
        found_s = time_s[0]
    if found_s > truth.onset_s:
        unfelt = np.abs(case.run.trace.columns[truth.worst] - clean)
        between = (time_s >= truth.onset_s) & (time_s < found_s - ONSET_S)
    elif truth.cause == "sensor_lag":
        smooth = uniform_filter1d(clean, int(_SMOOTH_S / PERIOD_S))
        unfelt = np.abs(smooth - np.interp(time_s - truth.magnitude, time_s, smooth))
        between = (time_s >= found_s + ONSET_S) & (time_s < truth.onset_s)
    else:
        return False
    return np.sqrt(np.mean(unfelt[between] ** 2)) < noise_degC


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
