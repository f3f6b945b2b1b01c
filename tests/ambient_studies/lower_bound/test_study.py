"""The bank against known filters and noise, the limit of models whose place beside it is known, and the command."""

import numpy as np
import pytest
from scipy.signal import lfilter

from ambient_studies.lower_bound.study import Seeds, fitted, gram, lower_bounds, rmse_degC
from ambient_trainer.data.trace import Trace
from ambient_trainer.estimators.base import Effort
from ambient_trainer.estimators.library.free import FreeFilterEstimator
from ambient_trainer.estimators.model_file import model_of
from ambient_trainer.simulator import simulate_many

from ..mitigation.sample_report import constant_model

PERIOD_S = 2.0
COLUMNS = ("a_degC", "b_degC")


def _run(seed, noise_degC=0.0, samples=3000):
    """The ambient is a known filter of two wandering sensors, plus noise."""
    random = np.random.default_rng(seed)
    a, b = 25 + np.cumsum(random.normal(size=(2, samples)), axis=1)
    kept = np.exp(-PERIOD_S / 8000.0)  # a time constant of the bank's
    lows = b[0] + lfilter([0, 1 - kept], [1, -kept], b - b[0])
    ambient = 1.7 * a - 0.4 * b - 0.3 * lows + 4 + noise_degC * random.normal(size=samples)
    return Trace("run", np.arange(samples) * PERIOD_S, {"a_degC": a, "b_degC": b, "ambient_degC": ambient})


@pytest.mark.parametrize("noise_degC", [0.0, 0.5])
def test_a_filter_of_the_bank_is_found_and_noise_is_the_bound(noise_degC):
    weights = fitted([gram(_run(seed, noise_degC), COLUMNS, 6) for seed in range(3)])
    scored = [gram(_run(seed, noise_degC), COLUMNS, 6) for seed in (7, 8)]
    assert rmse_degC(weights, scored) == pytest.approx(noise_degC, rel=0.03, abs=1e-3)


def test_the_ridge_keeps_a_large_bank_from_learning_noise():
    """Short runs, many weights: what it foresees of another run is not far from the noise."""
    short = [gram(_run(seed, noise_degC=0.5, samples=40), COLUMNS, 14) for seed in range(2)]
    greedy = np.linalg.lstsq(sum(each.quadratic for each in short), sum(each.linear for each in short), rcond=None)[0]
    scored = [gram(_run(seed, noise_degC=0.5, samples=40), COLUMNS, 14) for seed in range(20, 30)]
    assert rmse_degC(fitted(short), scored) < 0.9 * rmse_degC(greedy, scored)


SCENARIO, PERIOD_S = "2.5", 5.0
SEEDS = Seeds((6, 7, 8), (3, 4))


def test_a_model_that_was_fitted_to_the_scenario_is_its_own_bound():
    """A free filter of order 2, fitted to the runs that the bound is fitted to."""
    traces = [each.trace for each in simulate_many([(SCENARIO, seed) for seed in SEEDS.fitted], PERIOD_S)]
    model, seen = model_of(FreeFilterEstimator(2).fit(traces, Effort(starts=4)), [], {}), []
    [found] = lower_bounds(model, [SCENARIO], SEEDS, PERIOD_S, lambda *each: seen.append(each))
    steps = ("model", "its own order", "bank", "every zone")
    assert [what for what, _, _ in seen[-4:]] == [f"scenario {SCENARIO}: {step}" for step in steps]
    own = found.filters[0]
    assert own.name == "free filter of order 2"
    assert (own.sensors, own.weights) == (5, 2 + 5 * 3 + 1)
    assert found.ratio(own) == pytest.approx(1.0, abs=0.01)


def test_the_models_error_is_over_the_scored_runs():
    [bound] = lower_bounds(constant_model(21.0), [SCENARIO], SEEDS, PERIOD_S, lambda *_: None)
    traces = [each.trace for each in simulate_many([(SCENARIO, seed) for seed in SEEDS.scored], PERIOD_S)]
    mean_squares = [np.mean((trace.reference - 21.0) ** 2) for trace in traces]
    assert bound.model_rmse_degC == pytest.approx(np.sqrt(np.mean(mean_squares)), rel=1e-9)
    assert bound.samples == sum(len(trace.time_s) for trace in traces)
    assert bound.filters[0].name == "free filter of order 1"
    assert bound.filters[0].sensors == 1


def test_the_command_prints_and_writes(figures, saved):
    options = ("--scenarios", "1,2.5", "--seeds", "3", "--fitted", 2, "--period", 5)
    found, out = figures("limit", saved(constant_model(22.0)), *options)
    assert [each["scenario"] for each in found["scenarios"]] == ["1", "2.5"]
    assert found["simulated"] is True
    for each in found["scenarios"]:
        assert f" {each['model_rmse_degC']:.3f} " in out
    assert "simulated" in out
