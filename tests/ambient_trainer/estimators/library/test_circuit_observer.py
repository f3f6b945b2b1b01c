"""``circuit_observer`` on walked circuits, from the fit to the file that a device runs; it is the Kalman filter."""

import json

import numpy as np
import pytest
from scipy.linalg import expm

from ambient_trainer.data.grid import Segment
from ambient_trainer.estimators.base import Effort
from ambient_trainer.estimators.library.circuit_observer import CircuitObserver, RandomWalkAmbient
from ambient_trainer.estimators.model_file import model_of
from ambient_trainer.estimators.report import report_of
from ambient_trainer.evaluation.evaluate import evaluate_trace
from ambient_trainer.lti.response import response_degC
from ambient_trainer.lti.statespace import dc_gain

from .conftest import walked

ONE = Effort(starts=1)


@pytest.fixture(scope="module")
def fit():
    return CircuitObserver().fit([walked(1, samples=2500)], ONE)


@pytest.fixture(scope="module")
def model(fit):
    return model_of(fit, [], {})


def test_a_lone_sensor_gives_its_time_constant_and_noise_back():
    alone = {"tau_s": (90.0,), "exchange": 0.0, "node_walk": 0.15, "noise_degC": 0.4, "period_s": 2.0}
    found = CircuitObserver().fit([walked(seed, samples=12_000, **alone) for seed in (1, 2)], ONE)
    known = {each.name: each for each in found.parameters}
    for name, truth in (("tau_a", 90.0), ("q_a", 0.15)):
        low, high = known[name].interval95
        assert low < truth < high < 2 * low
    # the filter draws lines between samples, which is smoother than noise: what serves it is less than the sensor's own
    assert 0.3 * 0.4 * np.sqrt(2.0) < known["r_a"].value < 0.4 * np.sqrt(2.0)
    assert found.fallbacks == {}
    assert found.converged


def test_on_other_runs_it_errs_like_the_filter_that_knows_the_truth_and_its_interval_covers(fit, model):
    """The true circuit's filter is the best there is; what was fitted leaves hardly more on a run that it never saw."""
    circuit = RandomWalkAmbient(fit.inputs, 0.3)
    truth = np.log([60, 200, 120, 1, 1, *[0.004] * 3, *[0.02] * 3, *[0.05 * np.sqrt(10.0)] * 3])
    held_out = walked(2)
    segment = Segment(10.0, np.vstack([held_out.columns[name] for name in fit.inputs]), held_out.reference[None])
    best = np.std(held_out.reference - response_degC(circuit.filter(truth), "first-order", segment.inputs, 10.0))
    scored = [evaluate_trace(model, walked(seed)) for seed in (2, 3)]
    assert scored[0].metrics.rmse_degC < 1.05 * best
    assert scored[0].baseline.metrics.rmse_degC > 1.3 * best
    assert 0.87 <= np.mean([each.coverage[90] for each in scored]) <= 0.93
    assert 0.45 <= np.mean([each.coverage[50] for each in scored]) <= 0.55


def test_it_has_a_fallback_an_input_and_figures_in_plain_json(fit, model):
    assert list(model.fallbacks) == ["a", "b", "c"]
    for name, fallback in model.fallbacks.items():
        assert [each.name for each in fallback.inputs] == [each for each in "abc" if each != name]
        assert set(fallback.inputs) < set(model.main.inputs)
        smaller = fit.fallbacks[name]
        assert dc_gain(smaller.system).sum() == pytest.approx(1.0, abs=1e-9)
        assert fit.rmse_degC < smaller.rmse_degC < 2 * fit.rmse_degC
    data = json.loads(json.dumps(report_of(fit).data, allow_nan=False))
    half = data["half_width_90_degC"]
    assert 0 < half["10"] < half["50"] < half["90"] < half["99"]
    assert data["noise_gain"] > 1.0
    assert list(data["fallbacks"]) == ["a", "b", "c"]
    assert data["states_of_circuit"] == 4


@pytest.mark.parametrize(("search", "evaluation"), [(0, 8), (1, 2)])
def test_cancelled_in_the_main_search_or_in_a_fallback_it_keeps_the_main_one(search, evaluation):
    effort = Effort(starts=1)

    def cancel(number, count, square):
        if (number, count) == (search, evaluation):
            effort.budget.cancel()

    found = CircuitObserver().fit([walked(4, samples=800)], effort, cancel)
    assert found.stopped
    assert not found.converged
    assert found.fallbacks == {}
    assert model_of(found, [], {}).provenance["fit"]["stopped"]


SENSORS = ("a_degC", "b_degC", "c_degC")
THETA = np.log([60.0, 200.0, 120.0, 1.5, 0.5, 0.002, 0.004, 0.001, 0.02, 0.05, 0.03, 0.2, 0.4, 0.1])


def searched(segments):
    return RandomWalkAmbient(SENSORS, 0.3, segments, dict(zip(RandomWalkAmbient(SENSORS, 0.3).names, THETA)))


def segment_of(trace):
    return Segment(10.0, np.vstack([trace.columns[name] for name in SENSORS]), trace.reference[None])


def test_it_is_the_kalman_filter_stepped_through_time():
    """A discrete Kalman filter at a hundredth of the period, its covariance running from what is known at first."""
    circuit = RandomWalkAmbient(SENSORS, 0.3)
    segment = segment_of(walked(1, samples=60))
    h = 0.1
    A, Q, variance = circuit.process(THETA)
    step, H, R, P = expm(A * h), np.eye(3, 4), np.diag(variance / h), np.eye(4)
    for _ in range(40_000):
        P = step @ P @ step.T + Q * h
        K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
        P = P - K @ H @ P
    stay = step - K @ H @ step
    x = np.linalg.solve(np.eye(4) - stay, K @ segment.inputs[:, 0])
    said = [x[3]]
    for before, after in zip(segment.inputs.T, segment.inputs.T[1:]):
        for part in range(1, 101):
            x = stay @ x + K @ (before + (after - before) * part / 100)
        said.append(x[3])
    found = response_degC(circuit.filter(THETA), "first-order", segment.inputs, segment.period_s)
    # h is 0.1 s, and the noise that Q adds within it is taken to come at once
    np.testing.assert_allclose(found, said, atol=0.02 * np.std(segment.outputs))
    assert np.abs(found - segment.inputs.mean(axis=0)).max() > 1.0  # it is no mean of its inputs


def test_slopes_are_differences_and_far_off_all_is_finite():
    structure = searched([segment_of(walked(2, samples=200))])
    slopes = structure.slopes(THETA, np.zeros(1), 0)
    for index, h in enumerate(1e-5 * np.eye(len(THETA))):
        across = (structure.regressors(THETA + h, 0)[0] - structure.regressors(THETA - h, 0)[0]) / 2e-5
        np.testing.assert_allclose(slopes[index], across, atol=1e-6 * max(1.0, np.abs(across).max()))
    structure = searched([segment_of(walked(2, samples=50))])
    with np.errstate(all="ignore"):
        for far in (THETA + 300.0, THETA + 8.0, THETA - 8.0):
            assert np.isfinite(structure.regressors(far, 0)[0]).all()
            assert np.isfinite(structure.slopes(far, np.zeros(1), 0)).all()
