"""A record beside the circuit with its effects: what of it is simulated, what the start was, what runs away."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ambient_trainer.diagnosis import model as model_module
from ambient_trainer.diagnosis.causes import all_candidates
from ambient_trainer.diagnosis.model import WIDER, Effect, Model, view
from ambient_trainer.diagnosis.setting import setting_of

N = 240
TIME_S = 10.0 * np.arange(N)
START = np.array([32.0, 27.0, 23.0])


def test_a_view_of_the_true_model_leaves_nothing(world) -> None:
    seen = view(world.model, world.record)
    # a body is attached at a sample, and half a sample before: it then lacks what it took up meanwhile
    most = 0.06 if world.case.body and world.case.onset_s is not None else 0.015
    assert np.sqrt(np.mean(seen.residual_degC**2)) < most
    np.testing.assert_allclose(seen.start, START, atol=0.1)
    np.testing.assert_allclose(seen.model_degC, world.nodes_degC, atol=0.15)
    np.testing.assert_array_equal(seen.model_degC[world.model.plant.reads], seen.truth_degC)
    without = view(Model(world.model.plant), world.record)
    assert np.sqrt(np.mean(without.residual_degC**2)) > 0.05


@pytest.mark.parametrize("world", ["contact", "convection", "mass"], indirect=True)
def test_starts_are_those_of_the_closed_loop(world) -> None:
    seen = view(world.model, world.record)
    for node, step in enumerate(0.05 * np.eye(3)):
        up, down = (world.integrated(start_degC=START + each) for each in (step, -step))
        np.testing.assert_allclose(seen.starts[node], (up - down) / 0.1, atol=0.03)


def test_a_bad_guess_ends_at_the_same_place(world) -> None:
    fresh = view(world.model, world.record)
    bad = replace(fresh, start=START + np.array([6.0, -8.0, 5.0]), model_degC=fresh.model_degC[::-1] + 3.0)
    again = view(world.model, world.record, bad)
    np.testing.assert_allclose(again.start, fresh.start, atol=2e-3)
    np.testing.assert_allclose(again.simulated_degC, fresh.simulated_degC, atol=2e-3)


@pytest.mark.parametrize("world", ["coupling", "mass"], indirect=True)
def test_what_follows_a_neighbour_is_as_without_it(world) -> None:
    """The view of a model beside another's is the view of that model."""
    twice = replace(world.effect, values=2.0 * world.effect.values)
    other = Model(world.model.plant, (twice,))
    one = view(other, world.record)
    beside = view(other, world.record, view(world.model, world.record))
    np.testing.assert_allclose(one.residual_degC, beside.residual_degC, atol=2e-3)
    assert np.sqrt(np.mean(one.residual_degC**2)) > 0.05


def test_what_is_stated_is_wider_than_the_standard_error(chain) -> None:
    inputs = chain.inputs(N)
    record = chain.record(inputs, chain.integrated(inputs, START))
    source = replace(chain.effect(record, "heat_source at shell", (0.5,)), covariance=np.diag([0.01, 0.0]))
    told = source.magnitude(view(chain.model(), record))
    assert told.ci95 == pytest.approx((0.5 - WIDER * 0.196, 0.5 + WIDER * 0.196))


def test_sensor_errors_are_of_the_truth(chain) -> None:
    inputs = chain.inputs(N)
    nodes = chain.integrated(inputs, START)
    model = chain.model()
    setting = setting_of(model, [view(model, chain.record(inputs, nodes))])
    found = {str(each.cause): each for each in all_candidates(setting)}
    read = nodes.copy()
    read[1] += 0.1 * (nodes[1] - 25.0) + 0.4
    read[2] += 2.0 / 3600 * np.maximum(0.0, TIME_S - 800.0)
    for cause, onset_s, values in (
        ("sensor_gain at board", None, [0.1, 0.4]),
        ("sensor_drift at shell", 800.0, [2 / 3600]),
    ):
        effect = Effect(found[cause], onset_s, None, np.array(values), np.eye(len(values) + 1))
        model = model.with_effect(effect)
    seen = view(model, chain.record(inputs, read))
    np.testing.assert_allclose(seen.simulated_degC[:, 20:], read[:, 20:], atol=0.03)
    np.testing.assert_allclose(seen.truth_degC[:, 20:], nodes[:, 20:], atol=0.03)
    # what a doubtful sensor reads is not taken for the node
    np.testing.assert_allclose(seen.nodes_degC[:, 20:], nodes[:, 20:], atol=0.03)
    assert model.trusted_sensors() == {0}


def test_an_effect_that_was_always_there_makes_no_sensor_doubtful(chain) -> None:
    inputs = chain.inputs(N)
    model = chain.model()
    setting = setting_of(model, [view(model, chain.record(inputs, chain.integrated(inputs, START)))])
    late = next(each for each in all_candidates(setting) if str(each.cause) == "sensor_lag at board")
    assert model.with_effect(Effect(late, None, None, np.ones(1), np.eye(2), known=True)).trusted_sensors() == {0, 1, 2}


@pytest.mark.parametrize(("onset_s", "first"), [(None, 1.0), (0.0, 0.5), (-5.0, 1.0), (5.0, 0.0)])
def test_a_window_is_the_share_of_each_sample(chain, onset_s: float | None, first: float) -> None:
    record = chain.record(np.zeros((2, 5)), np.zeros((3, 5)))
    window = model_module.windowed(record, onset_s)
    assert window[0] == first
    np.testing.assert_array_equal(window[1:], np.ones(4))
    np.testing.assert_allclose(model_module.windowed(record, 22.5), [0, 0, 0.25, 1, 1])


@pytest.mark.parametrize("world", ["coupling"], indirect=True)
def test_a_runaway_is_no_simulation_and_no_crash(world) -> None:
    """Heat that grows with the temperature without bound: told by its not being finite."""
    wild = Model(world.model.plant, (replace(world.effect, values=np.array([-40.0])),))
    for like in (None, view(world.model, world.record)):
        assert not np.isfinite(view(wild, world.record, like).simulated_degC).all()


@pytest.mark.parametrize("world", ["convection"], indirect=True)
def test_a_loss_that_bends_the_wrong_way_runs_away_or_settles(world) -> None:
    """A loss that shrinks with the square of the difference is simulated, or is no simulation: never half of one."""
    wild = Model(world.model.plant, (replace(world.effect, values=np.array([-0.2, 0.0])),))
    seen = view(wild, world.record)
    assert np.isfinite(seen.simulated_degC).all() or np.isnan(seen.simulated_degC).all()
