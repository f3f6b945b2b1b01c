"""Where much is left that a black box explains, what was found is named, but as less sure; where most is, it is not."""

import importlib

import numpy as np
import pytest

from ambient_trainer.diagnosis.diagnose import diagnose
from ambient_trainer.diagnosis.result import UNKNOWN

SHARES = [(0.8, "heat_source"), (0.3, UNKNOWN)]


@pytest.fixture(scope="module")
def heated(simulated):
    """The board is heated by its current, and by as much again that nobody has logged."""
    walk = np.convolve(np.random.default_rng(12).standard_normal(1299), np.ones(100), "valid")
    unlogged_W = 1.6 * walk / walk.std()
    time_s = 30.0 * np.arange(1200)
    return simulated(
        2, heat_W=lambda now, degC: 0.9 * now["current_A"] ** 2 + np.interp(now["time_s"], time_s, unlogged_W)
    )


@pytest.mark.parametrize(("share", "name"), SHARES)
def test_the_more_a_black_box_explains_the_less_is_named(circuit, heated, monkeypatch, share, name):
    module = importlib.import_module("ambient_trainer.diagnosis.diagnose")
    whole = diagnose(circuit, [heated])
    assert (whole.verdict_cause.name, whole.explained_share) == ("heat_source", 1.0)
    before, after = whole.verdict.gain.rmse_before_degC, whole.verdict.gain.rmse_after_degC
    monkeypatch.setattr(module, "_floor_degC", lambda own: before - (before - after) / share)
    found = diagnose(circuit, [heated])
    assert found.verdict_cause.name == name
    if name != UNKNOWN:
        assert found.verdict.confidence == pytest.approx(share * whole.verdict.confidence, rel=0.01)
        assert found.notes
