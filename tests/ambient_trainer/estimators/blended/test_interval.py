"""The fit of a variance against known ones."""

from __future__ import annotations

import numpy as np
import pytest

from ambient_trainer.estimation.error_variance import least_squares_weights, weighted_quantile


def test_a_known_variance_comes_back_and_nothing_turns_negative():
    random = np.random.default_rng(3)
    terms = np.vstack([np.ones(40_000), random.exponential(1.0, 40_000), random.exponential(1.0, 40_000)])
    error = random.standard_normal(40_000) * np.sqrt(np.array([0.2, 0.5, 0.0]) @ terms)
    found = least_squares_weights(error, terms, np.ones(40_000))
    assert found == pytest.approx([0.2, 0.5, 0.0], abs=0.03)
    assert (found >= 0).all()


def test_what_counts_twice_is_like_having_it_twice():
    random = np.random.default_rng(4)
    terms = np.vstack([np.ones(500), random.exponential(1.0, 500)])
    error = random.standard_normal(500) * np.sqrt(terms.sum(axis=0))
    twice = least_squares_weights(np.r_[error, error[:100]], np.c_[terms, terms[:, :100]], np.ones(600))
    weighted = least_squares_weights(error, terms, np.r_[np.full(100, 2.0), np.ones(400)])
    assert weighted == pytest.approx(twice, rel=1e-6)


def test_a_weighted_quantile_leaves_that_share_of_the_weight_below():
    random = np.random.default_rng(5)
    values, weight = random.standard_normal(20_000), random.uniform(0, 1, 20_000)
    for share in (0.5, 0.9, 0.98):
        at = weighted_quantile(values, weight, share)
        assert weight[values <= at].sum() / weight.sum() == pytest.approx(share, abs=1e-3)
