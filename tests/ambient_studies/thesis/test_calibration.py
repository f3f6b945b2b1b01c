"""The shipped phone meets the published figures; the search lowers the cost of its guess; the command says how well."""

import numpy as np
import pytest

from ambient_studies.thesis import calibration
from ambient_studies.thesis.calibration import FORMULAS, SCENARIOS, calibrate, formula_errors, statistics
from ambient_studies.thesis.outcome import outcomes
from ambient_studies.thesis.published import published_results, sensor_statistics
from ambient_trainer.simulator import load_device, simulate
from ambient_trainer.simulator.device import load_constants


def shipped_values():
    return {name: each.value for name, each in load_constants().items()}


def test_the_published_formulas_give_the_published_errors_from_the_recovered_means():
    names = ("flash", "battery", "usb", "display")
    for scenario in ("1", "2.1", "2.3", "2.4"):
        sensors = np.array([0.0, *(sensor_statistics()[scenario, name].mean_degC for name in names)])
        for model in set(FORMULAS) - {"linear_combined"}:  # whose coefficients are rounded to what is 0.4 degC
            gains, offset = calibration.formulas()[model]
            published = published_results()[scenario, model].mbe_degC
            assert 20 - gains @ sensors - offset == pytest.approx(published, abs=0.05)


def test_every_shipped_mean_and_standard_deviation_is_within_its_bar():
    found = outcomes(load_device(), 5)
    assert len(found) == 28
    assert [each for each in found if not each.within] == []
    # of the trace that is written
    values = simulate("2.1", seed=5).trace.column("flash_degC")
    flash = [each.simulated_degC for each in found if (each.scenario, each.sensor) == ("2.1", "flash")]
    assert flash == [values.mean(), values.std()]


def test_what_candidates_feel_is_the_trace_without_noise():
    [shipped] = calibration.record([shipped_values()], 0)
    found = statistics(shipped)["2.3", "battery"]
    values = simulate("2.3", seed=0).trace.column("battery_degC")
    assert values.mean() == pytest.approx(found.mean_degC, abs=0.02)
    assert values.std() == pytest.approx(found.std_degC, abs=0.02)
    assert len(formula_errors(shipped)) == len(SCENARIOS) * len(FORMULAS)


@pytest.mark.slow
def test_the_search_lowers_the_cost_of_its_guess_within_the_bounds():
    some = ("conductance_W_K.usb-frame", "activities.streaming.heat_W.soc", "chamber.wobble_degC")
    constants = {name: load_constants()[name] for name in some}  # the others stay as they are shipped
    seen = []
    first = calibrate(constants, 2, 0, lambda evaluations, cost: seen.append((evaluations, cost)))
    assert first.cost < 0.7 * first.cost_before
    assert (seen[0], seen[-1]) == ((1, first.cost_before), (first.evaluations, first.cost))
    assert all(constants[name].low <= value <= constants[name].high for name, value in first.values.items())


@pytest.mark.slow
def test_the_command_prints_how_well_the_phone_is_calibrated(trainer):
    status, out, _ = trainer("calibrate-phone", "--budget", 0, "--seed", 1)
    assert status == 0
    assert "28 of 28" in out
    assert float(out.split("correlation:")[1].strip().rstrip(".")) >= 0.85


@pytest.mark.slow
def test_the_shipped_constants_are_where_the_search_ends():
    """No step within the bounds lowers the linearised cost by as much as the search asks for to go on."""
    searched = calibration._Search(load_constants(), 0, None)
    theta = np.log(list(shipped_values().values()))
    found, jacobian = searched.at(theta), searched.jacobian(theta)
    free = jacobian[:, (theta > searched.low + 1e-3) & (theta < searched.high - 1e-3)]
    change = free @ np.linalg.lstsq(free, -found, rcond=None)[0]
    assert change @ change < 5e-4 * (found @ found)
