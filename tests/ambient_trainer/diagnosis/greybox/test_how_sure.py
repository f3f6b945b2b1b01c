"""How sure a finding is: less where much is left that a black box explains, and what later ones make needless goes."""

import importlib
from dataclasses import replace

import numpy as np
import pytest

from ambient_trainer.diagnosis.diagnose import diagnose
from ambient_trainer.diagnosis.findings import steps_of
from ambient_trainer.diagnosis.greybox.choice import SelectionStep
from ambient_trainer.diagnosis.greybox.mechanisms.heat import Heat
from ambient_trainer.diagnosis.greybox.mechanisms.sensor import Bias
from ambient_trainer.diagnosis.greybox.model import GreyBox, Number
from ambient_trainer.diagnosis.greybox.regression import fit
from ambient_trainer.diagnosis.greybox.revision import prune, refit_as
from ambient_trainer.diagnosis.greybox.stepwise import Selection, bare_fit
from ambient_trainer.diagnosis.greybox.trials import Trial
from ambient_trainer.diagnosis.result import UNKNOWN

from .conftest import heat

module = importlib.import_module("ambient_trainer.diagnosis.diagnose")  # its name is a function's, too

WALK = np.convolve(np.random.default_rng(12).standard_normal(1299), np.ones(100), "valid")
TIME_S = 30.0 * np.arange(1200)


def unlogged_W(now):
    return 1.6 * np.interp(now["time_s"], TIME_S, WALK / WALK.std())


@pytest.fixture(scope="module")
def heated(simulated):
    """The board is heated by its current, and by as much again that nobody has logged."""
    return simulated(2, heat_W=lambda now, degC: 0.9 * now["current_A"] ** 2 + unlogged_W(now))


@pytest.fixture(scope="module")
def whole(circuit, heated):
    """Its diagnosis where a black box does no better."""
    found = diagnose(circuit, [heated])
    assert (found.verdict_cause.name, found.explained_share, len(found.notes)) == ("heat_source", 1.0, 1)
    return found


@pytest.mark.parametrize("share", [0.8, 0.3])
def test_the_more_a_black_box_explains_the_less_sure_is_what_is_named(circuit, heated, whole, monkeypatch, share):
    before, after = whole.verdict.gain.rmse_before_degC, whole.verdict.gain.rmse_after_degC
    monkeypatch.setattr(module, "_floor_degC", lambda own: before - (before - after) / share)
    found = diagnose(circuit, [heated])
    assert found.verdict_cause == whole.verdict_cause
    assert found.verdict.confidence == pytest.approx(share * whole.verdict.confidence, rel=0.01)
    assert found.notes


@pytest.mark.parametrize("instrument", [False, True])
def test_no_instrument_is_blamed_for_it(circuit, simulated, recorded, instrument):
    trace = simulated(2, heat_W=lambda now, degC: 2.0 + unlogged_W(now))
    bare = bare_fit(GreyBox.of(circuit), recorded(trace))
    bias = Bias(("board",), (Number("bias_board", "degC", 5.0, scale=1.0),))
    constant = Heat(("board",), (Number("heat_board", "W", 2.0, scale=1.0),))
    taken = Trial.of(bare, fit(bare.model.with_mechanism(bias if instrument else constant), bare.records).refitted())
    step = SelectionStep(bare, taken, (taken,), 1)
    before, after = bare.held_out_rmse_degC, taken.rmse_degC
    floor_degC = before - (before - after) / 0.8
    found = module._diagnosis(circuit, [trace], Selection(bare, taken.fitted, (step,), step), floor_degC, ())
    assert (found.verdict_cause.name == UNKNOWN) is instrument


@pytest.fixture(scope="module")
def fits(circuit, simulated, recorded):
    """The board in the sun, whose light also falls on a panel that does no more than follow it: the bare circuit, with
    heat by the panel, and with both, where the first gains what no step has to."""
    trace = simulated(5, heat_W=lambda now, degC: 0.004 * now["sun_W_m2"] + 0.005 * now["current_A"])
    panel = trace.columns["sun_W_m2"] * (1 + 0.1 * trace.columns["humidity_frac"]) + 120 * trace.columns["current_A"]
    records = recorded(replace(trace, columns={**trace.columns, "panel_W": panel}))
    bare = bare_fit(GreyBox.of(circuit), records)
    first = fit(bare.model.with_mechanism(heat("panel_W", 0.003)), records, prior=bare.prior).refitted()
    both = fit(first.model.with_mechanism(heat("sun_W_m2", 0.003)), records, prior=bare.prior).refitted()
    return bare, first, both


def test_what_gains_less_than_a_step_has_to_goes(fits):
    _, _, both = fits
    lost = np.log(refit_as(both, both.model.without(0)).held_out_rmse_degC / both.held_out_rmse_degC)
    assert 0.025 < lost < 0.085
    assert [each.driver.text for each in prune(both, 0).model.mechanisms] == ["sun_W_m2"]


def test_it_is_not_sure_though_it_gained_much_when_it_was_taken(fits):
    bare, first, both = fits
    taken = [Trial.of(bare, first), Trial.of(first, both)]
    steps = (SelectionStep(bare, taken[0], (taken[0],), 1), SelectionStep(first, taken[1], (taken[1],), 1))
    panel, sun = steps_of(Selection(bare, both, steps, steps[0]), 0)
    assert taken[0].rmse_degC < 0.5 * bare.held_out_rmse_degC
    assert panel.confidence < 0.5 < sun.confidence


def test_heat_that_wanders_is_surely_no_heat_for_a_while(circuit, simulated, seed):
    """Two levels always do better than one on a random walk."""
    walk = np.cumsum(np.random.default_rng(seed).standard_normal(1200))
    heat_W = 0.3 * walk / np.std(walk)
    trace = simulated(seed, heat_W=lambda now, degC: np.interp(now["time_s"], 30.0 * np.arange(1200), heat_W))
    windows = [each for each in diagnose(circuit, [trace]).steps if (each.onset_s, each.end_s) != (None, None)]
    assert all(each.confidence < 0.61 for each in windows if each.cause.signal is None), seed


@pytest.mark.parametrize(
    ("driver", "value", "doubtful"),
    [
        ("load2_frac > 0.4", -4.6, True),
        ("load_frac", 4.6, False),
        ("compressor_W", -4.6, False),
        ("tec_A", -4.6, False),
    ],
)
def test_work_that_cools_stands_for_something_else(driver, value, doubtful):
    """A measured processor seemed to be cooled by its load, as a fan went with it."""
    assert heat(driver, value).ambiguous is doubtful
