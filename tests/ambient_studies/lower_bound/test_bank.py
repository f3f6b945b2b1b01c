"""The bank against filters that are known, run sample by sample, and against noise."""

import numpy as np
import pytest

from ambient_studies.lower_bound.bank import fitted, gram, rmse_degC
from ambient_trainer.data.trace import Trace

PERIOD_S = 2.0
COLUMNS = ("a_degC", "b_degC")


def _run(seed, noise_degC=0.0, samples=3000):
    """The ambient is a known filter of two wandering sensors, plus noise."""
    random = np.random.default_rng(seed)
    a, b = 25 + np.cumsum(random.normal(size=(2, samples)), axis=1)
    low, kept = b[0], np.exp(-PERIOD_S / 8000.0)  # a time constant of the bank's
    lows = []
    for value in b:
        lows.append(low)
        low = kept * low + (1 - kept) * value
    ambient = 1.7 * a - 0.4 * b - 0.3 * np.array(lows) + 4 + noise_degC * random.normal(size=samples)
    columns = {"a_degC": a, "b_degC": b, "ambient_degC": ambient}
    return Trace("run", np.arange(samples) * PERIOD_S, columns)


def test_a_filter_of_the_bank_is_found():
    weights = fitted([gram(_run(seed), COLUMNS, 6) for seed in range(3)])
    assert rmse_degC(weights, [gram(_run(9), COLUMNS, 6)]) < 1e-3


def test_noise_is_the_bound():
    weights = fitted([gram(_run(seed, noise_degC=0.5), COLUMNS, 6) for seed in range(3)])
    scored = [gram(_run(seed, noise_degC=0.5), COLUMNS, 6) for seed in (7, 8)]
    assert rmse_degC(weights, scored) == pytest.approx(0.5, rel=0.03)


def test_the_mean_square_is_that_of_the_errors():
    run = _run(4, noise_degC=0.5, samples=50)
    found = gram(run, COLUMNS, 1)
    weights = np.array([0.4, 0.5, 0.2, -0.1, 1.0])
    low = {name: run.columns[name][0] for name in COLUMNS}
    kept, squares = np.exp(-PERIOD_S / 2.0), []
    for k in range(50):
        now = [run.columns[name][k] for name in COLUMNS]
        said = 0.4 * now[0] + 0.5 * now[1] + 0.2 * low["a_degC"] - 0.1 * low["b_degC"] + 1.0
        squares.append((run.reference[k] - said) ** 2)
        low = {name: kept * low[name] + (1 - kept) * value for name, value in zip(COLUMNS, now)}
    assert rmse_degC(weights, [found, found]) == pytest.approx(np.sqrt(np.mean(squares)), rel=1e-9)


def test_the_ridge_keeps_a_large_bank_from_learning_noise():
    """Short runs, many weights: what it foresees of another run is not far from the noise."""
    short = [gram(_run(seed, noise_degC=0.5, samples=40), COLUMNS, 14) for seed in range(2)]
    greedy = np.linalg.lstsq(sum(each.quadratic for each in short), sum(each.linear for each in short), rcond=None)[0]
    scored = [gram(_run(seed, noise_degC=0.5, samples=40), COLUMNS, 14) for seed in range(20, 30)]
    assert rmse_degC(fitted(short), scored) < 0.9 * rmse_degC(greedy, scored)


def test_one_run_is_enough():
    assert rmse_degC(fitted([gram(_run(0), COLUMNS, 3)]), [gram(_run(1), COLUMNS, 3)]) < 0.5
