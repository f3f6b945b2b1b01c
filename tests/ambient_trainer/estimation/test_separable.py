"""Linear unknowns are solved for exactly, within bounds or not, and the gradient is that of what is left."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import lsq_linear

from ambient_trainer.data.grid import Segment
from ambient_trainer.estimation.structure import Unknowns, project

THETA = np.array([0.3, -0.8])


def _structure(seed, p=3, low=-np.inf, high=np.inf, scale=1.0, used=None):
    """Fixed and free parts that are smooth functions of theta, over two segments of which one has a gap."""
    random = np.random.default_rng(seed)
    segments = [Segment(1.0, np.zeros((1, count)), random.normal(size=(1, count))) for count in (12, 9)]
    segments[1].outputs[0, 4] = np.nan
    shapes = [(2, p + 1, 1, each.outputs.shape[1]) for each in segments]
    constant, moving = ([random.normal(size=shape) for shape in shapes] for _ in range(2))
    scales = np.ones(p) * scale
    used = np.arange(p) if used is None else np.array(used, dtype=int)

    def parts(weights, index):
        fixed, *free = constant[index][0] + np.tensordot(weights, moving[index], 1)
        return fixed, (np.array(free).reshape(p, *fixed.shape) * scales[:, None, None])[used]

    def slopes(theta, beta, index):
        whole = np.einsum("k,kfqn->kfqn", np.cos(theta), moving[index])
        return whole[:, 0] + np.tensordot(beta, (whole[:, 1:] * scales[:, None, None])[:, used], (0, 1))

    count = len(used)
    return SimpleNamespace(
        segments=segments,
        linear=Unknowns(tuple(map(str, used)), np.zeros(count), np.full(count, low), np.full(count, high)),
        regressors=lambda theta, index: parts(np.sin(theta), index),
        slopes=slopes,
    )


def _table(structure):
    """Target and regressors of all samples at THETA."""
    known = [~np.isnan(each.outputs[0]) for each in structure.segments]
    parts = [structure.regressors(THETA, index) for index in range(2)]
    target = [each.outputs[0, k] - fixed[0, k] for each, k, (fixed, _) in zip(structure.segments, known, parts)]
    return np.concatenate(target), np.concatenate([free[:, 0, k] for k, (_, free) in zip(known, parts)], axis=1).T


def _assert_gradient(structure, tolerance=1e-7):
    found, h = project(structure, THETA), 1e-5

    def square(theta):
        left = project(structure, theta).residual
        return left @ left

    numeric = [(square(THETA + e) - square(THETA - e)) / (2 * h) for e in h * np.eye(2)]
    np.testing.assert_allclose(2 * found.jacobian.T @ found.residual, numeric, atol=tolerance)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=40)
def test_without_bounds_it_is_ordinary_least_squares(seed):
    structure = _structure(seed)
    found, (target, free) = project(structure, THETA), _table(structure)
    beta = np.linalg.lstsq(free, target, rcond=None)[0]
    np.testing.assert_allclose(found.beta, beta, rtol=1e-8)
    assert found.residual @ found.residual == pytest.approx(np.sum((target - free @ beta) ** 2))
    _assert_gradient(structure)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=60)
def test_within_bounds_it_is_that_of_scipy(seed):
    structure = _structure(seed, low=0.0, high=0.1)
    found, (target, free) = project(structure, THETA), _table(structure)
    wanted = lsq_linear(free, target, (0.0, 0.1), method="bvls", tol=1e-14)
    np.testing.assert_allclose(found.beta, wanted.x, atol=1e-9)
    assert ((found.beta >= 0) & (found.beta <= 0.1)).all()
    margin = np.abs(found.beta[:, None] - [0.0, 0.1]).min(axis=1)
    push = np.abs(free.T @ (target - free @ found.beta))
    if ((margin == 0) | (margin > 1e-3)).all() and ((margin > 0) | (push > 1e-2)).all():  # else a kink
        _assert_gradient(structure, 1e-6)


def test_regressors_that_say_nothing_the_same_or_on_other_scales():
    found, fewer = (project(each, THETA) for each in (_structure(1, scale=[1, 1, 0]), _structure(1, used=[0, 1])))
    np.testing.assert_allclose(found.beta, [*fewer.beta, 0.0], atol=1e-12)
    np.testing.assert_allclose(np.abs(found.jacobian.T @ found.residual), np.abs(fewer.jacobian.T @ fewer.residual))
    found, one = (project(_structure(2, used=used), THETA) for used in ([0, 0], [0]))
    np.testing.assert_allclose(found.beta, np.repeat(one.beta / 2, 2))
    assert found.residual @ found.residual == pytest.approx(one.residual @ one.residual)
    scale = np.array([1e-9, 1.0, 1e9])
    scaled, plain = (project(_structure(3, scale=each), THETA) for each in (scale, 1.0))
    np.testing.assert_allclose(scaled.beta * scale, plain.beta, rtol=1e-9)


@pytest.mark.parametrize(("low", "high"), [(5.0, 6.0), (-6.0, -5.0)])
def test_every_weight_may_be_at_a_bound(low, high):
    structure = _structure(5, low=low, high=high)
    np.testing.assert_array_equal(np.abs(project(structure, THETA).beta), np.full(3, 5.0))
    _assert_gradient(structure, 1e-5)


def test_there_may_be_no_linear_unknown():
    structure = _structure(4, used=[])
    found = project(structure, THETA)
    assert found.beta.shape == (0,)
    assert found.residual @ found.residual == pytest.approx(np.sum(_table(structure)[0] ** 2))
    _assert_gradient(structure)
