"""Tests whether an estimator keeps the contract of ``base``: for whoever adds one."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from ambient_model.model import LEVELS_PERCENT
from ambient_model.trace import REFERENCE, split_column
from ambient_trainer.data.trace import Trace
from ambient_trainer.estimators.base import Effort, Estimator, Fit
from ambient_trainer.lti.response import states


def check_estimator(estimator: Estimator, training: Sequence[Trace], other: Trace) -> Fit:
    """Fit an estimator with one start, test what it gives on ``other``, and return the fit for further tests.

    ``other`` is a trace without gaps, of some hundred samples. An :class:`AssertionError` names the part of the
    contract that does not hold.
    """
    searches: list[int] = []
    effort = Effort(starts=1)
    fit = estimator.fit(training, effort, lambda number, *_: searches.append(number))
    assert max(searches, default=0) <= estimator.searches(effort), "searches() counts the searches of a fit"
    again = estimator.fit(training, effort)
    assert again.rmse_degC == fit.rmse_degC, "two fits with one seed agree"
    assert all(name in training[0].columns for name in fit.inputs), "inputs are trace columns"
    assert REFERENCE not in fit.inputs, "the reference is no input"
    for each in (fit, *fit.fallbacks.values()):
        _check_fitted(each, other)
    for name, fallback in fit.fallbacks.items():
        read = [split_column(column)[0] for column in fallback.inputs]
        assert name not in read, f"the fallback without {name} does not read it"
    return fit


def _check_fitted(fit: Fit, other: Trace) -> None:
    assert np.isfinite(fit.rmse_degC), "rmse_degC is finite"
    assert isinstance(fit.identifiable, bool), "identifiable is a bool"
    bands = [fit.interval_degC[level] for level in LEVELS_PERCENT]
    nested = all(b[0] <= a[0] <= a[1] <= b[1] for a, b in pairwise(bands))
    assert nested, "interval_degC has nested bands at 50, 90 and 98 %"
    estimate = fit.estimate_degC(other)
    assert estimate.shape == other.time_s.shape, "estimate_degC gives a value a sample"
    bare = Trace(other.path, other.time_s, {name: other.columns[name] for name in fit.inputs})
    assert np.array_equal(fit.estimate_degC(bare), estimate, equal_nan=True), "the estimate reads its inputs alone"
    half = len(other.time_s) // 2
    first = fit.estimate_degC(other.cut(None, float(other.time_s[half])))
    causal = np.allclose(first, estimate[:half], atol=1e-9, equal_nan=True)
    assert causal, "the estimate is causal: later samples do not change it"
    system = fit.discrete(float(other.time_s[1] - other.time_s[0]))
    assert np.abs(np.linalg.eigvals(system.A)).max(initial=0) < 1, "the recursion is stable"
    if fit.secondary is None:
        u = np.vstack([other.columns[name] for name in fit.inputs])
        start = np.asarray(np.linalg.solve(np.eye(len(system.A)) - system.A, system.B @ u[:, 0]), dtype=np.float64)
        x = states(system.A, system.B @ u, start)
        recursed = (system.C @ x + system.D @ u)[0] + system.offset[0]
        assert np.allclose(recursed, estimate, atol=1e-6), "the estimate is the recursion's, from equilibrium"
