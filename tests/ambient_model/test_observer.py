"""An observer is its two trackers and the two rules, whatever comes, and starts, coasts and ends as they do."""

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from ambient_model.blend import blended
from ambient_model.model import Model
from ambient_model.observer import Observer
from ambient_model.tracking import Tracker


def scattered(model: Model, period_s: float, seed: int) -> list[tuple[float, tuple[float | None, ...]]]:
    """Samples at any times, back ones too, with readings that may be missing or out of their ranges."""
    random = np.random.default_rng(seed)
    now_s, rows = 0.0, []
    for _ in range(random.integers(1, 40)):
        now_s += period_s * random.choice([0.0, 0.4, 1.0, 1.0, 1.0, 1.0, 2.0, 3.3, 9.0, 400.0, -5.0])
        drawn = random.uniform(-20, 90, len(model.main.inputs)).tolist()
        faulty = random.random(len(drawn)) < random.choice([0.0, 0.0, 0.2])
        wrong = None if random.random() < 0.7 else 1e6
        rows.append((float(now_s), tuple(wrong if fails else value for value, fails in zip(drawn, faulty))))
    return rows


@given(st.from_type(Model), st.integers(0, 2**32 - 1), st.sampled_from([None, 0.0, 200.0]))
def test_it_is_its_parts_whatever_comes(model: Model, seed: int, coast_s: float | None) -> None:
    """Secondary and main estimator, each a tracker of its own, have an estimate at the same moments."""
    period_s = model.main.discrete[0].period_s
    main, guard = Tracker(model.main, model.main.discrete[0], 90, coast_s), None
    if model.secondary is not None:
        guard = Tracker(model.secondary.estimator, model.secondary.estimator.discrete[0], 90, coast_s)
    observer, width = Observer(model, Tracker(model.main, model.main.discrete[0], 90, coast_s), 90, coast_s), 0.0
    for time_s, readings in scattered(model, period_s, seed):
        said, alone = observer.update(time_s, readings), main.update(time_s, readings)
        second = None if guard is None else guard.update(time_s, readings).ambient_degC
        if alone.ambient_degC is None:
            assert said == alone
            assert second is None
            continue
        ambient, weight = alone.ambient_degC, 0.0
        if model.secondary is not None:
            ambient, _, weight = blended(ambient, second, model.secondary.threshold_degC)
        status = "degraded" if weight > 0 and alone.status != "coasting" else alone.status
        assert (said.ambient_degC, said.status, said.used) == (ambient, status, alone.used)
        low, high = main.error_low_degC, main.error_high_degC
        if model.error_variance is not None:
            sigma = observer.sigma_degC
            assert sigma >= math.sqrt(model.error_variance.constant_degC2)
            assert alone.status != "coasting" or sigma >= width
            low, high = (end * sigma for end in model.error_variance.quantiles[90])
            width = sigma
        assert (said.low_degC, said.high_degC) == (ambient + low, ambient + high)
