"""Empirical Bayes against joint Gaussians that are written out, and limits that are known."""

import numpy as np
import pytest

from ambient_trainer.fleet.pooling import NormalEquations, deviance, improbability, pooled, posterior

P = 3


def units(count, samples, seed=0, noise=0.5, between=None, mean=None, groups=None):
    """Units in p coordinates with white noise: normal equations, true coordinates, regressors and data."""
    random = np.random.default_rng(seed)
    factor = np.linalg.cholesky(np.eye(P) if between is None else between)
    middle = np.zeros(P) if mean is None else mean
    c = middle + random.standard_normal((count, P)) @ factor.T
    if groups is not None:
        c += groups
    Z = random.standard_normal((count, samples, P))
    y = np.einsum("unp,up->un", Z, c) + noise * random.standard_normal((count, samples))
    H, g = np.einsum("uni,unj->uij", Z, Z), np.einsum("uni,un->ui", Z, y)
    return NormalEquations(H, g, (y**2).sum(axis=1), np.full(count, float(samples))), c, Z, y


def test_the_posterior_is_that_of_the_joint_gaussian():
    between = np.array([[1.0, 0.3, 0.0], [0.3, 0.5, 0.1], [0.0, 0.1, 0.2]])
    mean = np.array([1.0, -2.0, 0.5])
    normal, _, Z, y = units(1, 2, seed=3)
    found = posterior(normal.H / 0.25, normal.g / 0.25, mean, between)
    # y and c together are Gaussian: condition on y, of fewer samples than coordinates
    gain = between @ Z[0].T @ np.linalg.inv(Z[0] @ between @ Z[0].T + 0.25 * np.eye(2))
    np.testing.assert_allclose(found.mean[0], mean + gain @ (y[0] - Z[0] @ mean), atol=1e-12)
    np.testing.assert_allclose(found.covariance[0], between - gain @ Z[0] @ between, atol=1e-12)
    marginal = Z[0].T @ np.linalg.inv(Z[0] @ between @ Z[0].T + 0.25 * np.eye(2))
    np.testing.assert_allclose(found.information[0], marginal @ Z[0], atol=1e-10)
    np.testing.assert_allclose(found.vector[0], marginal @ y[0], atol=1e-10)


def test_the_distance_is_that_of_the_data_from_their_prior():
    between, mean = np.diag([1.0, 0.5, 0.2]), np.array([0.3, 0.0, -0.3])
    normal, _, _, _ = units(1, 40, seed=4)
    distance, freedom = deviance(normal.H / 0.25, normal.g / 0.25, mean, between)
    apart = np.linalg.solve(normal.H[0], normal.g[0]) - mean
    expected = apart @ np.linalg.inv(0.25 * np.linalg.inv(normal.H[0]) + between) @ apart
    assert distance[0] == pytest.approx(expected, rel=1e-6)
    assert freedom[0] == pytest.approx(P, rel=1e-6)


def test_mean_and_spread_are_recovered_from_units_of_few_samples():
    between = np.array([[0.6, 0.2, 0.0], [0.2, 0.3, 0.0], [0.0, 0.0, 0.1]])
    mean = np.array([1.0, 0.0, -1.0])
    normal, c, _, _ = units(2000, 5, seed=6, between=between, mean=mean)
    found = pooled(normal, np.zeros(2000, dtype=int), 1.0)
    assert (np.abs(found.mean - mean) < 4 * np.sqrt(np.diag(found.mean_covariance))).all()
    np.testing.assert_allclose(found.between, between, atol=0.1)
    assert found.variance_degC2 == pytest.approx(0.25, rel=0.1)
    # the posterior is nearer to the truth than either least squares or the mean, and says how near
    post = found.posterior(normal, np.zeros(2000, dtype=int))
    off = ((post.mean - c) ** 2).mean()
    alone = np.linalg.solve(normal.H, normal.g[..., None])[..., 0]
    assert off < 0.8 * min(((alone - c) ** 2).mean(), ((mean - c) ** 2).mean())
    inside = np.abs(post.mean - c) < 1.645 * np.sqrt(np.diagonal(post.covariance, axis1=1, axis2=2))
    assert 0.86 < inside.mean() < 0.94


def test_broken_units_do_not_bend_the_population():
    normal, _, _, _ = units(200, 60, seed=7, between=0.04 * np.eye(P))
    whole = pooled(normal, np.zeros(200, dtype=int), 1.0)
    g, square = normal.g.copy(), normal.square.copy()
    c = np.full(P, 50.0)
    for unit in range(6):
        square[unit] += 2 * c @ g[unit] + c @ normal.H[unit] @ c
        g[unit] += normal.H[unit] @ c
    bent = pooled(normal._replace(g=g, square=square), np.zeros(200, dtype=int), 1.0)
    assert np.abs(bent.mean - whole.mean).max() < 0.05
    assert np.trace(bent.between) < 1.5 * np.trace(whole.between)
    distance, _ = deviance(normal.H / 0.25, g / 0.25, bent.mean, bent.between)
    assert sorted(np.argsort(-improbability(distance))[:6]) == list(range(6))


def test_groups_are_one_level_more():
    group = np.arange(300) % 3
    centres = np.array([[2.0, 0, 0], [0, 0, 0], [-2.0, 0, 0]])
    normal, _, _, _ = units(300, 30, seed=8, between=0.04 * np.eye(P), groups=centres[group])
    found = pooled(normal, group, 1.0)
    np.testing.assert_allclose(found.groups, centres, atol=0.1)
    assert np.trace(found.between) < 0.25
    assert found.group_between[0, 0] > 1.0
    seen, _ = found.prior(np.array([0, -1]))
    np.testing.assert_allclose(seen, [found.groups[0], found.mean])
