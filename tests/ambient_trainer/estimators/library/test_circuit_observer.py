"""``circuit_observer`` on walked circuits, from the fit to the file that a device runs."""

import json

import numpy as np
import pytest

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
    density = 0.05 * np.sqrt(10.0)
    truth = np.log([60, 200, 120, 1, 1, *[0.004] * 3, *[0.02] * 3, *[density] * 3])
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
