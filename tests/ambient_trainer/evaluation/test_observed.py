"""Guard and spread over arrays are the device's, sample by sample, to 1e-9 degC."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from ambient_model.model import Model, Spread, Term
from ambient_model.observer import Observer
from ambient_model.tracking import Tracker
from ambient_trainer.data.trace import Array
from ambient_trainer.estimators.published import Observed, observe

ModelOf = Callable[..., Model]


def by_device(model: Model, u: Array, period_s: float) -> tuple[Array, Array, list[str]]:
    """Estimate, scale and status, one sample at a time."""
    [discrete] = [each for each in model.main.discrete if each.period_s == period_s]
    observer = Observer(model, Tracker(model.main, discrete))
    said, sigmas = [], []
    for k, row in enumerate(u.T.tolist()):
        said.append(observer.update(k * period_s, row))
        sigmas.append(1.0 if observer.sigma_degC is None else observer.sigma_degC)
    return np.array([each.ambient_degC for each in said]), np.array(sigmas), [each.status for each in said]


def sensors(samples: int, seed: int = 3) -> Array:
    random = np.random.default_rng(seed)
    usb = 25.0 + np.cumsum(random.normal(0.0, 0.4, samples))
    return np.vstack([usb, usb + 2.0 + np.cumsum(random.normal(0.0, 0.05, samples))])


def same(found: Observed, model: Model, u: Array, period_s: float) -> list[str]:
    ambient, scale, status = by_device(model, u, period_s)
    np.testing.assert_allclose(found.ambient_degC, ambient, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found.scale, scale, rtol=0, atol=1e-9)
    return status


@pytest.mark.parametrize("period_s", [0.1, 1.0, 10.0])
def test_a_whole_trace(guarded_of: ModelOf, period_s: float) -> None:
    model, u = guarded_of((0.1, 1.0, 10.0)), sensors(5000)
    found = observe(model, u, period_s)
    status = np.array(same(found, model, u, period_s))
    assert np.array_equal(status == "degraded", found.weight > 0)
    assert {*found.weight.tolist()} > {0.0, 1.0}
    assert np.ptp(found.scale) > 0.5


def test_without_guard_or_spread(guarded_of: ModelOf) -> None:
    whole, u = guarded_of(), sensors(500)
    terms = tuple(each for each in whole.spread.terms if each.of != "guard")
    unguarded = whole._replace(guard=None, spread=whole.spread._replace(terms=terms))
    for model in (unguarded, whole._replace(spread=None), unguarded._replace(spread=None)):
        found = observe(model, u, 1.0)
        same(found, model, u, 1.0)
        assert (found.scale == 1.0).all() == (model.spread is None)
        assert (found.weight == 0.0).all() == (model.guard is None)


def test_one_sample(guarded_of: ModelOf) -> None:
    model, u = guarded_of(), sensors(1)
    same(observe(model, u, 1.0), model, u, 1.0)


terms = st.builds(Term, st.sampled_from(["movement", "guard"]), st.floats(0.01, 1e6), st.floats(0, 100))


@given(st.lists(terms, max_size=4), st.floats(0, 9), st.floats(0.01, 5), st.integers(0, 2**32 - 1))
@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
def test_any_spread_and_threshold(
    guarded_of: ModelOf, drawn: list[Term], constant: float, threshold: float, seed: int
) -> None:
    whole = guarded_of()
    spread = Spread(constant, tuple(drawn), whole.spread.quantiles)
    model = whole._replace(guard=whole.guard._replace(threshold_degC=threshold), spread=spread)
    u = 25 + 5 * np.random.default_rng(seed).normal(size=(2, 80))
    found = observe(model, u, 1.0)
    ambient, scale, _ = by_device(model, u, 1.0)
    np.testing.assert_allclose(found.ambient_degC, ambient, rtol=0, atol=1e-9)
    # a root magnifies what is lost where a long lag has almost nothing left
    np.testing.assert_allclose(found.scale**2, scale**2, rtol=1e-9, atol=1e-9)
