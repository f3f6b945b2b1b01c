"""An observer is its two trackers and the two rules, whatever comes, and starts, coasts and ends as they do."""

import math
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ambient_model.blend import blended
from ambient_model.conformance import conformance_of
from ambient_model.model import Discrete, ErrorVariance, Estimator, Input, Model, Secondary, Term
from ambient_model.observer import Background, Observer
from ambient_model.tracking import Estimate, Tracker

BANDS = {50: (-0.25, 0.5), 90: (-0.5, 0.75), 98: (-1.0, 1.5)}
QUANTILES = {50: (-0.5, 0.75), 90: (-1.5, 2.0), 98: (-2.5, 3.0)}
TERMS = (Term("movement", 300.0, 0.5), Term("movement", 60.0, 12.0), Term("guard", 120.0, 0.125))
USB, BATTERY = Input("usb", "degC", "usb", -20.0, 90.0), Input("battery", "degC", "battery", -20.0, 70.0)


def lag_on(which: int, tau_s: float, offset: float) -> Estimator:
    """One lag on one of the two inputs."""
    initial = tuple(float(k == which) for k in range(2))
    kept = {period_s: math.exp(-period_s / tau_s) for period_s in (0.1, 1.0)}
    discrete = [
        Discrete(period_s, ((a,),), (tuple((1 - a) * each for each in initial),), ((1.0,),), ((0.0, 0.0),))
        for period_s, a in kept.items()
    ]
    return Estimator((USB, BATTERY), ("lagged",), tuple(discrete), offset, (initial,), BANDS)


def phone(guard: bool = True, spread: bool = True) -> Model:
    """The main estimator follows usb, the guard the battery; both say 20 degC where usb is at 25 and battery at 30."""
    main = lag_on(0, 20.0, -5.0)
    second = Secondary(lag_on(1, 60.0, -10.0), 1.5) if guard else None
    variance = ErrorVariance(0.25, TERMS if guard else TERMS[:2], QUANTILES) if spread else None
    conformance = conformance_of(main, ((25.0, 30.0),))
    return Model("phone", "today", "ambient_degC", main, {}, {}, conformance, second, variance)


def tracker_of(model: Model, period_s: float = 1.0, coast_s: float | None = None) -> Tracker:
    [discrete] = [each for each in model.main.discrete if each.period_s == period_s]
    return Tracker(model.main, discrete, 90, coast_s)


def observer_of(model: Model, period_s: float = 1.0, coast_s: float | None = None) -> Observer:
    return Observer(model, tracker_of(model, period_s, coast_s), 90, coast_s)


Rows = Sequence[tuple[float, tuple[float | None, ...]]]


def fed(observer: Observer | Tracker, rows: Rows) -> list[Estimate]:
    return [observer.update(time_s, readings) for time_s, readings in rows]


def moving(count: int, start: int = 0, period_s: float = 1.0) -> list[tuple[float, tuple[float | None, ...]]]:
    """The two agree at first, and are far apart after some minutes, when usb is heated."""
    rows: list[tuple[float, tuple[float | None, ...]]] = []
    for k in range(start, start + count):
        time_s = k * period_s
        swing = 3 * math.sin(time_s / 200)
        heat = 6 * math.sin((time_s - 300) / 400) if time_s > 300 else 0.0
        rows.append((time_s, (25 + swing + heat, 30 + swing)))
    return rows


def scattered(model: Model, period_s: float, seed: int) -> Rows:
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


seeds = st.integers(0, 2**32 - 1)


@given(st.from_type(Model), seeds, st.sampled_from([None, 0.0, 200.0]))
def test_it_is_its_parts_whatever_comes(model: Model, seed: int, coast_s: float | None) -> None:
    """Secondary and main estimator, each a tracker of its own, have an estimate at the same moments."""
    period_s = model.main.discrete[0].period_s
    main, guard = tracker_of(model, period_s, coast_s), None
    if model.secondary is not None:
        guard = Tracker(model.secondary.estimator, model.secondary.estimator.discrete[0], 90, coast_s)
    observer, width = observer_of(model, period_s, coast_s), 0.0
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


def test_a_new_start_is_initial_state() -> None:
    observer = observer_of(phone())
    assert observer.background() == Background(None, None)
    fed(observer, moving(900))
    anew = observer.update(5000.0, (25.0, 30.0))
    assert (anew.low_degC, anew.high_degC) == pytest.approx((20.0 - 1.5 * 0.5, 20.0 + 2.0 * 0.5))
    assert observer.update(9000.0, (None, 30.0)).status == "faulted"
    assert (observer.sigma_degC, observer.background()) == (None, Background(None, None))


def test_a_background_of_another_model_or_moment_does_not_fit() -> None:
    observer = observer_of(phone())
    fed(observer, moving(10))
    main, (guard, unrest, _) = observer.tracker.snapshot(), observer.background()
    assert observer.fits(main, Background(guard, unrest))
    for wrong in (
        Background(None, unrest),
        Background(guard, None),
        Background(guard._replace(step=guard.step + 1), unrest),
        Background(guard._replace(start_s=0.5), unrest),
        Background(guard._replace(period_s=0.1), unrest),
        Background(guard._replace(x=(1.0, 2.0)), unrest),
        Background(guard, unrest._replace(means_degC=(1.0,))),
        Background(guard, unrest._replace(squares_degC2=(1.0, 2.0))),
        Background(guard, unrest._replace(squares_degC2=(1.0, -2.0, 3.0))),
    ):
        assert not observer.fits(main, wrong)
    assert not observer_of(phone(guard=False)).fits(main, Background(guard, unrest))
    assert not observer_of(phone(spread=False)).fits(main, Background(guard, unrest))
