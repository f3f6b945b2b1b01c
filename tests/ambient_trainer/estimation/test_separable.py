"""Linear unknowns are solved for exactly, within bounds or not, and the residual's derivative says so."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import lsq_linear

from ambient_trainer.estimation.separable import project
from ambient_trainer.estimation.structure import Linearised, Unknowns


def _unknowns(p, low=-np.inf, high=np.inf):
    return Unknowns(tuple(f"w{k}" for k in range(p)), np.zeros(p), np.full(p, low), np.full(p, high))


def _problem(seed, r=20, p=3, P=2):
    """fixed and free as smooth functions of theta, with their exact slopes."""
    random = np.random.default_rng(seed)
    target = random.normal(size=r)
    f, F = random.normal(size=(P, r)), random.normal(size=(P, r, p))
    f0, F0 = random.normal(size=r), random.normal(size=(r, p))

    def at(theta):
        return Linearised(
            target,
            f0 + np.sin(theta) @ f,
            F0 + np.einsum("k,krp->rp", np.sin(theta), F),
            np.cos(theta)[:, None] * f,
            np.cos(theta)[:, None, None] * F,
        )

    return at


def _differences(residual, theta, h=1e-4):
    return np.array(
        [
            (8 * (residual(theta + h * e) - residual(theta - h * e))
             - (residual(theta + 2 * h * e) - residual(theta - 2 * h * e))) / (12 * h)
            for e in np.eye(len(theta))
        ]
    ).T  # fmt: skip


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=40)
def test_without_bounds_it_is_ordinary_least_squares(seed):
    at, theta = _problem(seed), np.array([0.3, -0.8])
    found = project(at(theta), _unknowns(3))
    here = at(theta)
    beta = np.linalg.lstsq(here.free, here.target - here.fixed, rcond=None)[0]
    np.testing.assert_allclose(found.beta, beta, rtol=1e-9)
    np.testing.assert_allclose(found.residual, here.target - here.fixed - here.free @ beta, atol=1e-12)

    def residual(theta):
        return project(at(theta), _unknowns(3)).residual

    np.testing.assert_allclose(found.jacobian, _differences(residual, theta), atol=1e-7)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=60)
def test_within_bounds_it_is_that_of_scipy(seed):
    at, theta = _problem(seed), np.array([0.3, -0.8])
    here, bounds = at(theta), _unknowns(3, 0.0, 0.1)
    found = project(here, bounds)
    wanted = lsq_linear(here.free, here.target - here.fixed, (0.0, 0.1), method="bvls", tol=1e-14)
    np.testing.assert_allclose(found.beta, wanted.x, atol=1e-9)
    assert ((found.beta >= 0) & (found.beta <= 0.1)).all()

    def residual(theta):
        return project(at(theta), bounds).residual

    margin = np.abs(found.beta[:, None] - [0.0, 0.1]).min(axis=1)
    gradient = np.abs(here.free.T @ found.residual)
    if ((margin == 0) | (margin > 1e-3)).all() and ((margin > 0) | (gradient > 1e-2)).all():  # else a kink
        np.testing.assert_allclose(found.jacobian, _differences(residual, theta), atol=1e-6)


def test_a_regressor_that_says_nothing_is_left_alone():
    here = _problem(1)(np.array([0.3, -0.8]))
    used = np.array([1.0, 1.0, 0.0])
    found = project(replace(here, free=here.free * used, free_slope=here.free_slope * used), _unknowns(3))
    fewer = project(replace(here, free=here.free[:, :2], free_slope=here.free_slope[:, :, :2]), _unknowns(2))
    np.testing.assert_allclose(found.beta, [*fewer.beta, 0.0], atol=1e-12)
    np.testing.assert_allclose(found.jacobian, fewer.jacobian, atol=1e-10)


def test_two_equal_regressors_share_the_weight():
    here = _problem(2)(np.array([0.3, -0.8]))
    found, one = (
        project(replace(here, free=here.free[:, some], free_slope=here.free_slope[:, :, some]), _unknowns(len(some)))
        for some in ([0, 0], [0])
    )
    np.testing.assert_allclose(found.beta, np.repeat(one.beta / 2, 2))
    np.testing.assert_allclose(found.residual, one.residual, atol=1e-12)
    np.testing.assert_allclose(found.jacobian, one.jacobian, atol=1e-10)


def test_large_and_small_regressors_count_alike():
    here = _problem(3)(np.array([0.3, -0.8]))
    scale = np.array([1e-9, 1.0, 1e9])
    scaled = Linearised(here.target, here.fixed, here.free * scale, here.fixed_slope, here.free_slope * scale)
    found, plain = project(scaled, _unknowns(3)), project(here, _unknowns(3))
    np.testing.assert_allclose(found.beta * scale, plain.beta, rtol=1e-9)
    np.testing.assert_allclose(found.jacobian, plain.jacobian, atol=1e-9)


def test_without_linear_unknowns_the_residual_is_what_it_is():
    here = _problem(4, p=0)(np.array([0.3, -0.8]))
    found = project(here, _unknowns(0))
    assert found.beta.shape == (0,)
    np.testing.assert_array_equal(found.residual, here.target - here.fixed)
    np.testing.assert_array_equal(found.jacobian, -here.fixed_slope.T)


@pytest.mark.parametrize(("low", "high"), [(5.0, 6.0), (-6.0, -5.0)])
def test_every_weight_may_be_at_a_bound(low, high):
    at, theta = _problem(5), np.array([0.3, -0.8])
    found = project(at(theta), _unknowns(3, low, high))
    here = at(theta)
    np.testing.assert_array_equal(np.abs(found.beta), np.full(3, 5.0))
    np.testing.assert_allclose(found.jacobian, -(here.fixed_slope + here.free_slope @ found.beta).T)
