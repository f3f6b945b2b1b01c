"""Brute force: every subset of a small set, refitted directly on raw regressors without each block."""

import itertools

import numpy as np
import pytest
from scipy.linalg import null_space
from scipy.signal import cont2discrete, dlsim

from ambient_trainer.estimators.estimate import estimate_degC
from ambient_trainer.lti import dc_gain
from ambient_trainer.selection.grams import banks, gathered
from ambient_trainer.selection.search import numbered

from .conftest import PERIOD_S, data_of, made_up

POLES_S = (5.0, 50.0)
TOLERANCE_DEGC = 0.05


@pytest.fixture(scope="module")
def grams(small):
    return gathered(small.segments, small.blocks, small.sensors, POLES_S, TOLERANCE_DEGC)


def regressors(readings):
    """Per sensor the reading and its lags, by scipy's simulation; (N, 3 m)."""
    columns = []
    for u in readings:
        columns.append(u)
        for tau_s in POLES_S:
            lag = (np.array([[each]]) for each in (-1 / tau_s, 1 / tau_s, 1.0, 0.0))
            hold = cont2discrete(tuple(lag), PERIOD_S, method="foh")
            columns.append(dlsim((*hold[:4], PERIOD_S), (u - u[0])[:, None])[1][:, 0] + u[0])
    return np.column_stack(columns)


@pytest.fixture(scope="module")
def raw(small):
    """The regressors of all sensors, and the root of what a degree of white noise in one makes."""
    impulse = np.zeros((1, 4000))
    impulse[0, 1] = 1.0
    response = regressors(impulse)
    return regressors(small.segments[0].inputs), np.linalg.cholesky(response.T @ response).T * TOLERANCE_DEGC


def direct(small, raw, members):
    """Per block the sum of squares of a fit to the other samples: penalties as rows, the unit gain by elimination."""
    every, own = raw
    X, y = every[:, [3 * each + k for each in members for k in range(3)]], small.segments[0].outputs[0]
    squares = []
    for block in small.blocks:
        kept = np.ones(len(y), dtype=bool)
        kept[block.first : block.last] = False
        n = kept.sum()
        noisy = np.kron(np.eye(len(members)), own)
        still = [np.sqrt(TOLERANCE_DEGC**2 + small.sensors[each].step_degC ** 2 / 12) for each in members]
        at_rest = np.kron(np.diag(still), np.ones((1, 3)))
        rows = np.vstack([X[kept], np.sqrt(n) * noisy, np.sqrt(n) * at_rest])
        rows = np.column_stack([rows, np.concatenate([np.ones(n), np.zeros(len(rows) - n)])])
        target = np.concatenate([y[kept], np.zeros(len(rows) - n)])
        c = np.append(np.ones(X.shape[1]), 0.0)
        one, free = c / (c @ c), null_space(c[None])
        b = one + free @ np.linalg.lstsq(rows @ free, target - rows @ one, rcond=None)[0]
        held = slice(block.start, block.stop)
        squares.append(np.sum((y[held] - X[held] @ b[:-1] - b[-1]) ** 2))
    return squares


@pytest.mark.parametrize("size", [1, 2, 3, 4, 5])
def test_every_subset_scores_as_its_direct_refit(small, raw, grams, size):
    subsets = list(itertools.combinations(range(5), size))
    found = grams.squares(subsets)
    assert found.shape == (len(subsets), len(small.blocks))
    for members, squares in zip(subsets, found):
        np.testing.assert_allclose(squares, direct(small, raw, members), rtol=1e-6)


def test_the_filter_is_that_of_the_direct_fit_and_its_gains_sum_to_one(small, grams):
    for members in [(0,), (1, 4), (0, 1, 2, 3, 4)]:
        assert dc_gain(grams.fitted(members)).sum() == pytest.approx(1.0, abs=1e-9)
    members = numbered(small, ("left", "right"))
    columns = [small.sensors[each].column for each in members]
    estimate = estimate_degC(grams.fitted(members), "first-order", columns, small.traces[0])
    X = np.column_stack([regressors(small.segments[0].inputs[list(members)]), np.ones(len(estimate))])
    weights = np.linalg.lstsq(X, estimate, rcond=None)[0]
    np.testing.assert_allclose(X @ weights, estimate, atol=1e-8)
    assert weights[[0, 1, 2, 3, 4, 5]].sum() == pytest.approx(1.0, abs=1e-6)


def test_a_missing_reference_counts_nowhere(small):
    trace = made_up()
    trace.columns["ambient_degC"][100:180] = np.nan
    holed = data_of(trace)
    found = gathered(holed.segments, holed.blocks, holed.sensors, POLES_S, TOLERANCE_DEGC)
    assert found.samples.sum() == len(trace.time_s) - 80
    assert np.isfinite(found.squares([(0, 1)])).all()


@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_every_bank_is_shown_often_enough_by_the_trace(order):
    found = banks(order, 1.0, 20_000.0)
    assert len(set(found)) == len(found) >= 4
    assert all(len(each) == order and each[-1] <= 1000 and list(each) == sorted(each) for each in found)
