"""``free_observer``: what physics demands of it holds, and what it chooses is chosen by data that it did not see."""

from dataclasses import replace

import numpy as np
import pytest

from ambient_trainer.data.grid import Segment
from ambient_trainer.estimation.error_variance import sigma_degC
from ambient_trainer.estimation.search import search
from ambient_trainer.estimators.base import Effort
from ambient_trainer.estimators.library.free import FreeFilterEstimator
from ambient_trainer.estimators.library.free_observer import Choice, FreeObserver, _Selection, constrained, selected
from ambient_trainer.estimators.model_file import model_of
from ambient_trainer.estimators.registry import estimator
from ambient_trainer.evaluation.evaluate import evaluate_trace
from ambient_trainer.lti.statespace import dc_gain

from .conftest import walked

ONE = Effort(starts=1)


def test_on_runs_that_it_never_saw_it_does_as_well_as_one_without_demands_and_its_interval_holds():
    fit = FreeObserver().fit([walked(1, samples=1000)], ONE)
    scored = [evaluate_trace(model_of(fit, [], {}), walked(seed)) for seed in (2, 3)]
    unconstrained = FreeFilterEstimator(len(fit.states)).fit([walked(1, samples=1000)], ONE)
    theirs = evaluate_trace(model_of(unconstrained, [], {}), walked(2))
    assert scored[0].metrics.rmse_degC < 1.02 * theirs.metrics.rmse_degC
    assert 0.87 <= np.mean([each.coverage[90] for each in scored]) <= 0.93


def test_of_what_a_controller_heats_a_share_follows_the_ambient():
    """A room that a proportional controller keeps near 21 degC: the ambient moves it by a fifth."""
    trace = walked(1, samples=1000)
    near = {"room_degC": 21 + 0.2 * (trace.columns["a_degC"] - 21), "ambient_degC": trace.columns["ambient_degC"]}
    fit = FreeObserver().fit([replace(trace, columns=near)], ONE)
    assert fit.dc_gains[0] == pytest.approx(5, rel=0.05)
    assert fit.rmse_degC < 0.5 * fit.baseline.rmse_degC


def test_what_is_searched_is_what_is_exported_where_the_air_is_near_zero_and_the_sensor_is_not():
    air = np.random.default_rng(1).normal(0, 0.1, 600).cumsum()
    logged = Segment(10.0, 20 + 0.8 * (air - air.mean())[None], (air - air.mean())[None])
    best = search(structure := constrained([logged], True, 1, 0.01), 1, 0).best
    assert dc_gain(structure.system(best.theta, best.beta)).sum() == pytest.approx(1, abs=1e-3)


@pytest.mark.parametrize("known", [slice(250, None), slice(70)])
def test_a_reference_that_was_logged_for_a_part_of_the_time_is_enough(known):
    trace = walked(1, samples=400)
    part = np.full(400, np.nan)
    part[known] = trace.reference[known]
    fit = FreeObserver().fit([replace(trace, columns={**trace.columns, "ambient_degC": part})], ONE)
    assert fit.rmse_degC < fit.baseline.rmse_degC


def choice(order, noise_degC, offset_degC, *errors_degC):
    return Choice(True, order, noise_degC, offset_degC, tuple(each**2 for each in errors_degC))


def test_the_lowest_order_then_the_most_noise_and_offset_that_are_not_worse():
    tried = [choice(order, 0.01, 0.0, rmse, rmse) for order, rmse in ((1, 0.9), (2, 0.503), (3, 0.5), (4, 0.499))]
    assert selected(tried) == tried[1]
    more = [*tried, choice(2, 0.03, 0.0, 0.5035, 0.5035), choice(2, 0.1, 0.0, 0.6, 0.6)]
    assert selected(more) == more[4]
    # worse in one block, better in another: no significant difference
    offsets = [*more, choice(2, 0.03, 0.3, 0.45, 0.57), choice(2, 0.03, 1.0, 0.59, 0.6)]
    assert selected(offsets) == offsets[6]
    selection = _Selection((), ONE, None)
    selection._grid = lambda: ()
    selection.tried = dict.fromkeys([choice(1, 0.01, 0, *[1] * 5), Choice(False, 1, 0.01, 0, (0.1,) * 4 + (9,))], ())
    assert selection.run().unit_gain  # free ones leave less in most blocks, but more over all


def test_few_levels_do_not_make_large_gains():
    """Three sensors that differ by a constant at either of two levels: any gains fit, the offset keeps them small."""
    level = np.repeat([-40.0, 90.0, -40.0, 90.0], 200)
    u = level + np.random.default_rng(1).normal(0, 0.05, (3, 800)) + np.array([[1.0], [0.2], [0.0]]) * (level < 0)
    gains = []
    for offset_degC in (0.0, 1.0):
        best = search(structure := constrained([Segment(10.0, u, level[None])], True, 1, 0.01, offset_degC), 2, 0).best
        gains.append(np.linalg.norm(dc_gain(structure.system(best.theta, best.beta))))
    assert gains[1] < 0.8 < gains[0]


def test_where_the_sensors_offsets_are_open_the_interval_is_no_narrower_than_they_make_it():
    """A log of two levels: whatever the offsets are, the blocks are predicted as well."""
    fit = FreeObserver().fit([walked(1, samples=400)], ONE)
    offset_degC = fit.details["choice"]["offset_degC"]
    assert fit.error_variance.constant_degC2 >= offset_degC**2 * np.square(fit.dc_gains).sum()
    assert sigma_degC(fit.error_variance, np.array([300.0]), 0.0, 10.0) > 100  # nothing shows how right that is


@pytest.mark.parametrize("evaluation", [3, 150])
def test_ctrl_c_keeps_the_best_so_far(evaluation):
    """While the first order is searched, and while blocks are left out."""
    seen, effort = [], Effort(starts=2)

    def interrupt(start, number, square):
        seen.append(number)
        if len(seen) == evaluation:
            effort.budget.cancel()

    found = estimator("free_observer").fit([walked(6, samples=600)], effort, interrupt)
    assert (found.stopped, found.converged, "Stopped" in found.notes[0]) == (True, False, True)
    assert sum(found.dc_gains) == pytest.approx(1.0, abs=1e-9)
    assert model_of(found, [], {}).provenance["fit"]["stopped"]


@pytest.mark.slow
def test_a_lone_sensor_is_as_good_as_its_kalman_filter():
    alone = {"samples": 1500, "tau_s": (90.0,), "exchange": 0.0, "node_walk": 0.05, "noise_degC": 0.2}
    training, held_out = walked(1, **alone), walked(2, **alone)
    training, held_out = (
        replace(each, columns={name: each.columns[name] for name in ("a_degC", "ambient_degC")})
        for each in (training, held_out)
    )
    ours, filters = (
        evaluate_trace(model_of(estimator(name).fit([training], ONE), [], {}), held_out).metrics.rmse_degC
        for name in ("observer", "circuit_observer")
    )
    assert ours < 1.05 * filters
