"""What was tuned before another mechanism came is tuned again beside it."""

import numpy as np
import pytest
from scipy.signal import lfilter

from ambient_trainer.diagnosis.diagnose import diagnose
from ambient_trainer.diagnosis.greybox.expression import Expression
from ambient_trainer.diagnosis.greybox.mechanisms.coupling import ZoneLoss
from ambient_trainer.diagnosis.greybox.model import GreyBox, Number
from ambient_trainer.diagnosis.greybox.regression import fit
from ambient_trainer.diagnosis.greybox.stepwise import bare_fit, stepwise
from ambient_trainer.diagnosis.greybox.windows import sharpened

from .conftest import heat


def test_a_lag_is_refined_though_its_heat_is_not_the_last(circuit, simulated, recorded):
    time_s = 30.0 * np.arange(1200)
    current = simulated(3).columns["current_A"]
    late = lfilter([1 - np.exp(-30 / 400)], [1, -np.exp(-30 / 400)], current)
    trace = simulated(3, heat_W=lambda now, degC: 2 * np.interp(now["time_s"], time_s, late) + 0.004 * now["sun_W_m2"])
    records = recorded(trace)
    bare = bare_fit(GreyBox.of(circuit), records)
    model = bare.model.with_mechanism(heat("lag(current_A, 700)", 2.0)).with_mechanism(heat("sun_W_m2", 0.004))
    first = fit(model, records, prior=bare.prior)
    again = sharpened(first, 0)
    assert again.model.mechanisms[0].driver.level == pytest.approx(400, rel=0.1)
    assert again.rmse_degC < 0.5 * first.rmse_degC


@pytest.mark.parametrize("sun_m2", [0.0, 0.0006])
def test_a_zone_leaves_the_grid_once_all_is_there_and_shows_what_it_hid(sun_m2, circuit, simulated, recorded):
    trace = simulated(
        1,
        heat_W=lambda now, degC: now["current_A"] ** 2 + sun_m2 * now["sun_W_m2"],
        conductance_W_K=lambda now, degC: 1.2 if now["ambient_degC"] > 20 else 0.4,
    )
    zone = ZoneLoss(
        ("board",), (Number("change_board", "1", 0.5, low=-0.9, high=9.0),), Expression("ambient_degC > 23")
    )
    offered = [zone, heat("current_A^2", 1.0), heat("sun_W_m2", 0.001)]
    found = stepwise(bare_fit(GreyBox.of(circuit), recorded(trace)), offered=lambda *given: iter(offered)).final.model
    (level,) = (each.driver.level for each in found.mechanisms if each.cause == "convection_law")
    assert level == pytest.approx(20, abs=0.5)
    driven = {each.driver.text for each in found.mechanisms if each.cause == "heat_source"}
    assert driven == {"current_A^2", *(["sun_W_m2"] if sun_m2 else [])}


@pytest.mark.slow
def test_a_body_that_is_put_there_and_taken_away_is_no_cooling(circuit, simulated, seed):
    named, heated = 0, {"heat_W": lambda now, degC: 8 * now["current_A"]}
    for draw in range(seed, seed + 4):
        on_s, off_s = np.random.default_rng(draw).uniform([0.2, 0.5], [0.4, 0.8]) * 36_000
        mass = lambda now, degC, on_s=on_s, off_s=off_s: 0.6 * (on_s < now["time_s"] < off_s), 250.0
        first = diagnose(circuit, [simulated(draw, **heated, mass=mass)], [simulated(draw + 1, **heated)]).steps[0]
        found = first.cause.name == "thermal_mass"
        assert first.end_s == pytest.approx(off_s, abs=1800) if found else first.confidence < 0.9, seed
        named += found
    assert named >= 2, seed
