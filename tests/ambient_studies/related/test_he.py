"""He's regression: a quadratic world comes back, and the estimate is the kernel expansion written out."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from sklearn.svm import SVR

from ambient_model.faults import Refused
from ambient_studies.related import he
from ambient_trainer.data.trace import Trace

Made = Callable[..., Trace]


def quadratic(trace: Trace) -> np.ndarray:
    T, I = trace.columns["battery_degC"], -trace.columns["battery_current_A"]  # noqa: E741
    return 1.0 + 0.9 * T - 4.0 * I + 0.003 * T**2 - 0.05 * T * I + 0.8 * I**2


def world(trace: Trace, noise: float = 0.0) -> Trace:
    random = np.random.default_rng(9).standard_normal(len(trace.time_s))
    return replace(trace, columns={**trace.columns, "ambient_degC": quadratic(trace) + noise * random})


def test_a_quadratic_world_comes_back(made: Made) -> None:
    unseen = world(made(3000, seed=2))

    found = he.fit(world(made(6000, seed=1), noise=0.2)).estimate(unseen)

    assert np.sqrt(np.mean((found - unseen.reference) ** 2)) < 0.1
    assert unseen.reference.std() > 5.0


def test_the_estimate_is_the_expansion_over_the_support_vectors(made: Made) -> None:
    trace = world(made(2000, seed=1), noise=0.5)
    regression = he.fit(trace)

    scale, svr = regression.pipeline["scale"], regression.pipeline["svr"]
    x = np.column_stack([trace.columns["battery_degC"], -trace.columns["battery_current_A"]])
    learned = x[np.linspace(0, 1999, 600).round().astype(int)]
    z = (x - learned.mean(axis=0)) / learned.std(axis=0)
    assert np.allclose(scale.mean_, learned.mean(axis=0))
    expansion = svr.dual_coef_[0] @ (1.0 + svr.support_vectors_ @ z.T) ** 2 + svr.intercept_
    assert regression.estimate(trace) == pytest.approx(expansion, abs=1e-8)
    assert np.abs(svr.dual_coef_).max() <= svr.C
    assert svr.dual_coef_.sum() == pytest.approx(0.0, abs=1e-6)


def test_the_choice_is_that_of_contiguous_blocks() -> None:
    """Every choice of C and epsilon, scored by hand on fifths of the trace that the fit did not see."""
    trace = drifting()
    x = np.column_stack([trace.columns["battery_degC"], -trace.columns["battery_current_A"]])
    scores = {}
    for C in (0.1, 1.0, 10.0, 100.0):
        for epsilon in (0.1, 0.3, 1.0, 3.0):
            errors = []
            for block in np.array_split(np.arange(len(x)), 5):
                rest = np.setdiff1d(np.arange(len(x)), block)
                mean, std = x[rest].mean(axis=0), x[rest].std(axis=0)
                svr = SVR(kernel="poly", degree=2, gamma=1.0, coef0=1.0, C=C, epsilon=epsilon, tol=0.01)
                svr.fit((x[rest] - mean) / std, trace.reference[rest])
                errors.append(trace.reference[block] - svr.predict((x[block] - mean) / std))
            scores[C, epsilon] = np.mean([np.sqrt(np.mean(error**2)) for error in errors])

    svr = he.fit(trace).pipeline["svr"]

    assert (svr.C, svr.epsilon) == min(scores, key=scores.__getitem__)


def drifting() -> Trace:
    """A hundred samples whose relation to the ambient drifts, so that neighbours tell more than blocks."""
    rng = np.random.default_rng(6)
    time_s = np.arange(100.0)
    battery = 25.0 + 6.0 * np.sin(time_s / 15.0)
    current = -np.abs(np.sin(time_s / 4.0))
    ambient = battery + 5.0 * current + 6.0 * np.sin(time_s / 11.0) + rng.normal(0.0, 0.3, 100)
    columns = {"battery_degC": battery, "battery_current_A": current, "ambient_degC": ambient}
    return Trace("drifting", time_s, columns)


def test_a_charging_battery_discharges_nothing(made: Made) -> None:
    trace = made(1000, seed=1)
    regression = he.fit(world(trace))

    def with_current(value: float) -> np.ndarray:
        return regression.estimate(replace(trace, columns={**trace.columns, "battery_current_A": np.full(1000, value)}))

    assert np.array_equal(with_current(3.0), with_current(0.0))
    assert not np.array_equal(with_current(-3.0), with_current(0.0))


def test_too_few_samples_are_refused(made: Made) -> None:
    trace = made(400, seed=1)
    ambient = trace.reference.copy()
    ambient[9:] = np.nan

    with pytest.raises(Refused) as refused:
        he.fit(replace(trace, columns={**trace.columns, "ambient_degC": ambient}))

    assert str(refused.value) == (
        "made 1: 9 samples hold battery_degC, battery_current_A and ambient_degC, the least is 10; "
        "log them together, and longer"
    )
