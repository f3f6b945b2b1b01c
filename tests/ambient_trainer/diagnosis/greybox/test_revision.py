"""What an early step has chosen is tuned again beside later ones, or gives way to what does better."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter, lsim

from ambient_trainer.circuits.addition import with_body, with_edge
from ambient_trainer.data.trace import Trace
from ambient_trainer.diagnosis.forward import forward
from ambient_trainer.diagnosis.greybox.choice import SelectionStep
from ambient_trainer.diagnosis.greybox.context import Context
from ambient_trainer.diagnosis.greybox.expression import Expression
from ambient_trainer.diagnosis.greybox.mechanisms import coupling, heat, mass
from ambient_trainer.diagnosis.greybox.mechanisms.heat import Heat
from ambient_trainer.diagnosis.greybox.model import GreyBox, Number
from ambient_trainer.diagnosis.greybox.regression import fit
from ambient_trainer.diagnosis.greybox.revision import at_other_places, close_rivals, is_same, revise
from ambient_trainer.diagnosis.greybox.screening import screen
from ambient_trainer.diagnosis.greybox.stepwise import bare_fit, stepwise
from ambient_trainer.diagnosis.greybox.trials import Trial, fit_candidates
from ambient_trainer.diagnosis.greybox.windows import refine_timing
from ambient_trainer.diagnosis.record import records

from ...conftest import in_air
from .conftest import heat as heat_by


def begun(before, mechanism):
    return fit(before.model.with_mechanism(mechanism), before.records, prior=before.prior).refitted()


def test_heat_by_a_current_becomes_heat_by_its_square(circuit, simulated, recorded, seed):
    """Without the wind in the loss either does about as well."""
    hidden = {"heat_W": lambda now, _: 0.8 * now["current_A"] ** 2}
    held = recorded(simulated(seed, **hidden, conductance_W_K=lambda now, _: 0.3 + 0.12 * now["wind_m_s"]))
    bare = bare_fit(GreyBox.of(circuit), held)
    drivers = ("current_A", "current_A^2")
    by_current = [each for each in heat.candidates(Context(bare)) if type(each) is heat.Heat and each.key[2] in drivers]
    screened = screen(Context(bare), lambda context, columns: iter(by_current))
    trials = [replace(each, rmse_degC=1.0) for each in fit_candidates(bare, screened, lambda done, total: None)]
    plain = next(each for each in trials if each.mechanism.key[2] == "current_A")
    wind = next(each for each in coupling.candidates(Context(plain.fitted)) if each.key[2] == "wind_m_s")
    fitted = begun(plain.fitted, wind)
    (step,), after = revise([SelectionStep(bare, plain, tuple(trials), 2)], fitted, 0, close_rivals)
    assert step.chosen.mechanism.key[2] == "current_A^2", seed
    assert [each.key[2] for each in after.model.mechanisms] == ["current_A^2", "wind_m_s"], seed
    assert after.held_out_rmse_degC < 0.5 * fitted.held_out_rmse_degC, seed
    assert revise([step], after, 0, close_rivals) is None, seed


def test_what_takes_the_place_of_one_window_spares_the_other(circuit, simulated, recorded, seed):
    held = recorded(simulated(seed, heat_W=lambda now, _: 0.002 * now["sun_W_m2"]))
    bare = bare_fit(GreyBox.of(circuit), held)

    def window(onset_s, end_s):
        return Heat(("board",), (Number("heat_board", "W", 0.6, scale=1.0),), onset_s=onset_s, end_s=end_s)

    first, sunny = begun(bare, window(0.0, 6000.0)), begun(bare, heat_by("sun_W_m2", 0.002))
    both = begun(first, window(12000.0, 18000.0))
    trials = [replace(Trial.of(bare, each), rmse_degC=1.0) for each in (first, sunny)]
    _, after = revise([SelectionStep(bare, trials[0], tuple(trials), 2)], both, 0, close_rivals)
    assert [each.key[2] for each in after.model.mechanisms] == ["sun_W_m2"], seed


def test_what_was_chosen_is_told_from_another_window_at_the_same_place():
    early = Heat(("board",), (), onset_s=0, end_s=9)
    late, always = replace(early, onset_s=9, end_s=18), replace(early, onset_s=None, end_s=None)
    assert [is_same(each, early) for each in (replace(early, onset_s=0.5), late, always)] == [True, False, False]


def test_what_acts_on_a_body_neither_takes_its_place_nor_outlives_it(circuit, simulated, recorded, seed):
    """A body behind a body has nothing to hang on where it replaces the first, or where that was dropped."""
    held = recorded(simulated(seed, heat_W=lambda now, _: 0.8 * now["current_A"], mass=(0.5, 400.0)))
    bare = bare_fit(GreyBox.of(circuit), held)

    def with_body(before, at):
        return begun(before, next(each for each in mass.candidates(Context(before)) if each.places == (at,)))

    first = with_body(bare, "board")
    warmed, second = begun(first, next(heat.candidates(Context(first)))), with_body(first, "board_mass")
    tried = [replace(Trial.of(bare, each), rmse_degC=1.0, at_bounds=False) for each in (first, second, warmed)]
    assert revise([SelectionStep(bare, tried[0], tuple(tried), 3)], second, 0, close_rivals) is None, seed
    again = with_body(first, "board")
    both = tuple(replace(Trial.of(first, each), rmse_degC=1.0, at_bounds=False) for each in (again, second))
    assert revise([SelectionStep(first, both[0], both, 2)], again, 0, at_other_places) is None, seed
    alone, step = begun(bare, warmed.model.mechanisms[1]), SelectionStep(first, tried[2], tuple(tried[1:]), 2)
    assert revise([step], alone, 0, close_rivals) is None, seed


def test_a_lag_is_refined_though_its_heat_is_not_the_last(circuit, simulated, recorded):
    time_s = 30.0 * np.arange(1200)
    current = simulated(3).columns["current_A"]
    late = lfilter([1 - np.exp(-30 / 400)], [1, -np.exp(-30 / 400)], current)
    trace = simulated(3, heat_W=lambda now, degC: 2 * np.interp(now["time_s"], time_s, late) + 0.004 * now["sun_W_m2"])
    records = recorded(trace)
    bare = bare_fit(GreyBox.of(circuit), records)
    model = bare.model.with_mechanism(heat_by("lag(current_A, 700)", 2.0)).with_mechanism(heat_by("sun_W_m2", 0.004))
    first = fit(model, records, prior=bare.prior)
    again = refine_timing(first, 0)
    assert again.model.mechanisms[0].driver.level == pytest.approx(400, rel=0.1)
    assert again.rmse_degC < 0.5 * first.rmse_degC


@pytest.mark.parametrize("sun_m2", [0.0, 0.0006])
def test_a_zone_leaves_the_grid_once_all_is_there_and_shows_what_it_hid(sun_m2, circuit, simulated, recorded):
    trace = simulated(
        1,
        heat_W=lambda now, degC: now["current_A"] ** 2 + sun_m2 * now["sun_W_m2"],
        conductance_W_K=lambda now, degC: 1.2 if now["ambient_degC"] > 20 else 0.4,
    )
    zone = coupling.ZoneLoss(
        ("board",), (Number("change_board", "1", 0.5, low=-0.9, high=9.0),), Expression("ambient_degC > 23")
    )
    offered = [zone, heat_by("current_A^2", 1.0), heat_by("sun_W_m2", 0.001)]
    found = stepwise(bare_fit(GreyBox.of(circuit), recorded(trace)), offered=lambda *given: iter(offered)).final.model
    (level,) = (each.driver.level for each in found.mechanisms if each.cause == "convection_law")
    assert level == pytest.approx(20, abs=0.5)
    driven = {each.driver.text for each in found.mechanisms if each.cause == "heat_source"}
    assert driven == {"current_A^2", *(["sun_W_m2"] if sun_m2 else [])}


def test_heat_moves_to_where_it_is_once_what_hid_that_is_found(seed):
    """Of two heaters that go together the one is at an end of a row, and the other seems to be until that is known."""
    draw, time_s = np.random.default_rng(seed), 30.0 * np.arange(1200)
    row = with_edge(with_body(in_air("one three", 50, 4), "one", 50, 2), "one_mass", "three", 2)
    # one number alone is free: others would do for a place
    numbers = [replace(each, free=each.name == "R_one") for each in row.parameters]
    row = forward(replace(row, parameters=tuple(numbers)))
    air, big = 20 + np.repeat(draw.normal(0, 3, 30), 40), np.repeat(draw.uniform(0, 1, 40), 30)
    small = 0.5 * big + 0.5 * np.repeat(draw.uniform(0, 1, 24), 50)
    A = np.array([[-0.75, 0.0, 0.5], [0.0, -0.75, 0.5], [0.5, 0.5, -1.0]]) / 50
    B = np.array([[0.25, 0.0, 5.0], [0.25, 0.0, 0.0], [0.0, 2.0, 0.0]]) / 50
    inputs = np.column_stack([air, big, small])
    one, three = lsim((A, B, np.eye(3)[:2], np.zeros((2, 3))), inputs, time_s, [air[0]] * 3)[1].T
    columns = {"one_degC": one, "three_degC": three, "ambient_degC": air, "big_frac": big, "small_frac": small}
    noisy = {name: each + draw.normal(0, 0.03, 1200) for name, each in columns.items()}
    held = records(Trace("row", time_s, noisy), row.inputs, ["one_degC", "three_degC"], 30.0)

    def offered(context, columns):
        driven = {"big_frac": context.nodes, "small_frac": context.nodes[: len(context.known_heat)][:1]}
        for driver, nodes in driven.items():
            for node in nodes:
                yield Heat((node,), (Number(f"heat_{node}", "W", 0.0),), Expression(driver))

    steps = stepwise(bare_fit(GreyBox.of(row), held), offered=offered).steps
    assert [each.chosen and str(each.chosen.mechanism) for each in steps] == [
        "heat_source at one_mass by big_frac",
        "heat_source at one by small_frac",
        None,
    ], seed
