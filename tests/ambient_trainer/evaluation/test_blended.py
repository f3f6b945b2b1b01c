"""The blend with a secondary estimate and the error variance over arrays are the device's, sample by sample."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from ambient_model.model import ErrorVariance, Model, Term
from ambient_model.observer import Observer
from ambient_model.tracking import Tracker
from ambient_trainer.data.trace import Array
from ambient_trainer.estimation.error_variance import sigma_degC
from ambient_trainer.estimators.estimate import blended

ModelOf = Callable[..., Model]
terms = st.builds(Term, st.sampled_from(["movement", "guard"]), st.floats(0.01, 1e6), st.floats(0, 100))


def by_device(model: Model, u: Array, period_s: float) -> tuple[Array, Array, list[str]]:
    """Estimate, sigma and status, one sample at a time."""
    [discrete] = [each for each in model.main.discrete if each.period_s == period_s]
    observer = Observer(model, Tracker(model.main, discrete))
    estimates, sigmas = [], []
    for k, row in enumerate(u.T.tolist()):
        estimates.append(observer.update(k * period_s, row))
        sigmas.append(observer.sigma_degC)
    ambient = np.array([each.ambient_degC for each in estimates])
    return ambient, np.array(sigmas, float), [each.status for each in estimates]


def check(model: Model, u: Array, period_s: float) -> None:
    alone = [
        model._replace(main=each, secondary=None, error_variance=None)
        for each in (model.main, model.secondary.estimator)
    ]
    main, secondary = (by_device(each, u, period_s)[0] for each in alone)
    found = blended(main, secondary, model.secondary.threshold_degC)
    ambient, sigma, status = by_device(model, u, period_s)
    np.testing.assert_allclose(found.ambient_degC, ambient, rtol=0, atol=1e-9)
    assert np.array_equal(np.array(status) == "degraded", found.weight > 0)
    scale = sigma_degC(model.error_variance, found.ambient_degC, found.apart_degC, period_s)
    # a root magnifies what rounding leaves where a long lag has almost nothing left
    np.testing.assert_allclose(scale**2, sigma**2, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(("period_s", "samples"), [(0.1, 2000), (10.0, 2000), (1.0, 1)])
def test_a_whole_trace(guarded_of: ModelOf, period_s: float, samples: int) -> None:
    usb = 25.0 + np.cumsum(np.random.default_rng(3).normal(0.0, 0.4, samples))
    check(guarded_of((0.1, 1.0, 10.0)), np.vstack([usb, usb + 2.0]), period_s)


@given(st.lists(terms, max_size=4), st.floats(0, 9), st.floats(0.01, 5), st.integers(0, 2**32 - 1))
@settings(max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None)
def test_any_variance_and_threshold(
    guarded_of: ModelOf, drawn: list[Term], constant: float, threshold: float, seed: int
) -> None:
    whole = guarded_of()
    spread = ErrorVariance(constant, tuple(drawn), whole.error_variance.quantiles)
    model = whole._replace(secondary=whole.secondary._replace(threshold_degC=threshold), error_variance=spread)
    check(model, 25 + 5 * np.random.default_rng(seed).normal(size=(2, 80)), 1.0)
