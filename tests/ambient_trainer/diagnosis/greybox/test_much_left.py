"""Where much is left that a black box explains, what was found is named, but as less sure; where most is, it is not."""

import importlib

import numpy as np
import pytest

from ambient_trainer.diagnosis.diagnose import diagnose
from ambient_trainer.diagnosis.greybox.choice import Step
from ambient_trainer.diagnosis.greybox.mechanisms.heat import Heat
from ambient_trainer.diagnosis.greybox.mechanisms.sensor import Bias
from ambient_trainer.diagnosis.greybox.model import GreyBox, Number
from ambient_trainer.diagnosis.greybox.regression import fit
from ambient_trainer.diagnosis.greybox.stepwise import Selection, bare_fit
from ambient_trainer.diagnosis.greybox.trials import Trial
from ambient_trainer.diagnosis.result import UNKNOWN

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
    assert (found.verdict_cause.name, found.explained_share) == ("heat_source", 1.0)
    return found


@pytest.mark.parametrize("share", [0.8, 0.3])
def test_the_more_a_black_box_explains_the_less_is_named(circuit, heated, whole, monkeypatch, share):
    before, after = whole.verdict.gain.rmse_before_degC, whole.verdict.gain.rmse_after_degC
    monkeypatch.setattr(module, "_floor_degC", lambda own: before - (before - after) / share)
    found = diagnose(circuit, [heated])
    if share < 0.5:
        assert found.verdict_cause.name == UNKNOWN
    else:
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
    step = Step(bare, taken, (taken,), 1)
    before, after = bare.held_out_rmse_degC, taken.rmse_degC
    floor_degC = before - (before - after) / 0.8
    found = module._diagnosis(circuit, [trace], Selection(bare, taken.fitted, (step,), step), floor_degC, ())
    assert (found.verdict_cause.name == UNKNOWN) is instrument
