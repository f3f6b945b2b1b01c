"""The shipped phone meets the published figures; the search betters its guess; the command says what is left."""

from __future__ import annotations

import numpy as np
import pytest
import yaml
from click.testing import CliRunner

from ambient_studies.calibration import fit as fit_module
from ambient_studies.calibration.figures import FORMULAS, SCENARIOS, formula_errors, formulas, record, statistics
from ambient_studies.calibration.fit import calibrate, residuals
from ambient_studies.calibration.outcome import Outcome, outcome_table, outcomes
from ambient_studies.calibration.published import SensorFigure, published_errors, sensor_figures
from ambient_studies.calibration.rank import Ranked, rank_correlation, rank_table
from ambient_studies.cli import calibrate_phone
from ambient_studies.thesis.methods import MODELS
from ambient_trainer.simulator.calibrated import load_constants, shipped_values
from ambient_trainer.simulator.device import Chamber, Phone
from ambient_trainer.simulator.phone import simulate


@pytest.fixture(scope="module")
def shipped():
    return record([shipped_values()], 0)[0]


def test_the_published_figures_are_all_there():
    figures = sensor_figures()
    assert len(figures) == 16
    assert sum(each.std_degC is not None for each in figures) == 12
    assert figures[3] == SensorFigure("2.1", "battery", 27.47, 6.41)
    errors = published_errors()
    assert len(errors) == 60
    assert errors["3", "linear_combined"] == (12.22, 8.55, -0.73)


def test_the_published_formulas_give_the_published_errors_from_the_recovered_means():
    means = {(each.scenario, each.sensor): each.mean_degC for each in sensor_figures()}
    names = ("flash", "battery", "usb", "display")
    for scenario in ("1", "2.1", "2.3", "2.4"):
        sensors = np.array([0.0, *(means[scenario, name] for name in names)])
        for model in set(FORMULAS) - {"linear_combined"}:  # whose coefficients are rounded to what is 0.4 degC
            gains, offset = formulas()[model]
            assert 20 - gains @ sensors - offset == pytest.approx(
                published_errors()[scenario, model].mbe_degC, abs=0.05
            )


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_every_shipped_mean_and_standard_deviation_is_within_its_bar(seed):
    found = outcomes(Phone.shipped(), Chamber.shipped(), seed)
    assert len(found) == 28
    assert [each for each in found if not each.within] == []


def test_an_outcome_is_of_the_trace_that_is_written():
    found = {
        (each.scenario, each.sensor, each.figure): each for each in outcomes(Phone.shipped(), Chamber.shipped(), 5)
    }
    values = simulate("2.1", seed=5).column("flash_degC")
    assert found["2.1", "flash", "mean"].simulated_degC == values.mean()
    assert found["2.1", "flash", "std"].simulated_degC == values.std()


def test_the_bars_are_a_degree_and_thirty_percent():
    assert Outcome("1", "usb", "mean", 20.0, 20.99).within
    assert not Outcome("1", "usb", "mean", 20.0, 18.99).within
    assert Outcome("1", "usb", "std", 2.0, 2.59).within
    table = outcome_table([Outcome("1", "usb", "std", 2.0, 1.39)])
    assert table.rows == (("1", "usb", "std", "2.00", "1.39", "-0.61", "NO"),)
    assert table.caption.endswith("0 of 1.")


def test_what_candidates_feel_is_what_the_trace_says_but_for_noise(shipped):
    mean, std = statistics(shipped)["2.3", "battery"]
    values = simulate("2.3", seed=0).column("battery_degC")
    assert values.mean() == pytest.approx(mean, abs=0.02)
    assert values.std() == pytest.approx(std, abs=0.02)
    assert set(shipped) == set(SCENARIOS)
    assert len(formula_errors(shipped)) == len(SCENARIOS) * len(FORMULAS)


def test_a_candidate_of_a_batch_is_itself(shipped):
    other = {**shipped_values(), "conductance_W_K.usb-frame": 0.2}
    batch = record([other, shipped_values()], 0)
    assert batch[1]["3"].sensors_degC == pytest.approx(shipped["3"].sensors_degC, abs=1e-8)
    assert abs(batch[0]["3"].sensors_degC - shipped["3"].sensors_degC).max() > 0.5


def test_a_perfect_candidate_has_no_residuals(shipped, monkeypatch):
    found, errors = statistics(shipped), formula_errors(shipped)
    figures = tuple(
        SensorFigure(each.scenario, each.sensor, *found[each.scenario, each.sensor]) for each in sensor_figures()
    )
    monkeypatch.setattr(fit_module, "sensor_figures", lambda: figures)
    monkeypatch.setattr(fit_module, "published_errors", lambda: errors)
    assert np.abs(residuals(shipped)).max() < 1e-12
    monkeypatch.setattr(fit_module, "published_errors", published_errors)
    assert np.abs(residuals(shipped)).max() > 0.1


def test_the_search_betters_its_guess_within_the_bounds():
    some = ("conductance_W_K.usb-frame", "power_W.streaming.soc", "chamber.wobble_degC")
    constants = {
        name: each if name in some else each.model_copy(update={"start": each.value})
        for name, each in load_constants().items()
    }
    told = []
    first = calibrate(constants, 2, 0, lambda evaluations, cost: told.append((evaluations, cost)))
    assert first.cost < 0.7 * first.cost_before
    assert told[0] == (1, first.cost_before)
    assert told[-1] == (first.evaluations, first.cost)
    assert all(constants[name].low <= value <= constants[name].high for name, value in first.values.items())


def test_the_rank_correlation_is_of_the_published_and_the_simulated_errors():
    rows = [
        Ranked(scenario, model, float(index), float(index) ** 2)
        for index, (scenario, model) in enumerate((s, m) for s in ("1", "2.1", "2.3", "2.4", "3", "4") for m in MODELS)
    ]
    assert rank_correlation(rows) == pytest.approx(1.0)
    table = rank_table(rows)
    assert len(table.rows) == 10
    assert table.rows[1][:2] == ("model1_ss", "1.00 / 1.00")
    turned = [Ranked(each.scenario, each.model, each.published_degC, -each.simulated_degC) for each in rows]
    assert rank_correlation(turned) == pytest.approx(-1.0)


def test_the_command_prints_what_is_left_good_or_bad():
    done = CliRunner().invoke(calibrate_phone.command, ["--budget", "0", "--seed", "1"])
    assert done.exit_code == 0, done.output
    assert "28 of 28" in done.output
    correlation = float(done.output.split("correlation:")[1].strip().rstrip("."))
    assert correlation >= 0.85


def test_the_command_writes_a_constants_file(tmp_path, monkeypatch):
    monkeypatch.setattr("ambient_studies.calibration.rank.simulate_many", _stop)
    path = tmp_path / "phone.yaml"
    done = CliRunner().invoke(calibrate_phone.command, ["--budget", "1", "-o", str(path)])
    assert isinstance(done.exception, _Enough)
    read = load_constants(path)
    assert list(read) == list(load_constants())
    # one evaluation is that of the guesses
    assert all(each.value == pytest.approx(each.start, rel=1e-3) for each in read.values())
    assert "NO" in done.output
    assert yaml.safe_load(path.read_text())["burst_frac"]["unit"] == "1"


class _Enough(Exception):
    pass


def _stop(*_, **__):
    raise _Enough


@pytest.mark.slow
def test_the_shipped_constants_are_what_the_command_finds():
    found = calibrate(load_constants(), calibrate_phone.BUDGET)
    assert found.values == pytest.approx(shipped_values(), rel=2e-3)
