"""What is fitted of an effect stays where it makes sense, and moves by as much as it is told to."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ambient_trainer.diagnosis.effect_parameters import EffectParameter, Kind, moved, small_step, unknowns, within
from ambient_trainer.diagnosis.model import Effect, Model

PERIOD_S = 10.0
SLOWEST_S, FASTEST_S = 6 * 3600.0, 0.5
STEPS = st.floats(-1e5, 1e5)


@pytest.fixture(scope="module")
def record(chain):
    inputs = chain.inputs(240)
    return chain.record(inputs, chain.integrated(inputs, np.array([32.0, 27.0, 23.0])))


@pytest.fixture(scope="module")
def coupling(chain, record) -> Effect:
    return chain.effect(record, "ambient_coupling at shell", (0.8,), 605.0, 1605.0)


@pytest.fixture(scope="module")
def mass(chain, record) -> Effect:
    return chain.effect(record, "thermal_mass at board", (0.2,), 605.0, shape=300.0)


@given(value=st.floats(-50, 50), step=STEPS, low=st.floats(-20, 0), high=st.floats(0, 20))
@settings(max_examples=200, deadline=None)
def test_a_coefficient_ends_within_its_bounds(coupling, value: float, step: float, low: float, high: float) -> None:
    effect = replace(coupling, values=np.array([value]), candidate=replace(coupling.candidate, bounds=(low, high)))
    unknown = EffectParameter(0, Kind.COEFFICIENT)
    taken = within(effect, unknown, step, PERIOD_S)
    there = moved(effect, unknown, taken).values[0]
    assert low - 1e-12 <= there <= high + 1e-12
    if low <= value <= high:
        assert abs(taken) <= abs(step) + 1e-12
        assert taken * step >= 0.0
        if low <= value + step <= high:
            assert taken == step


@given(shape=st.floats(FASTEST_S, SLOWEST_S), step=STEPS)
@settings(max_examples=200, deadline=None)
def test_a_shape_moves_by_half_at_most_and_stays_between_its_ends(mass, shape: float, step: float) -> None:
    effect = replace(mass, candidate=mass.candidate.reshaped(shape))
    taken = within(effect, EffectParameter(0, Kind.SHAPE), step, PERIOD_S)
    assert abs(taken) <= min(0.5, abs(step)) + 1e-12
    assert taken * step >= -1e-12
    there = moved(effect, EffectParameter(0, Kind.SHAPE), taken).candidate.shape
    assert there == pytest.approx(shape * np.exp(taken))
    assert FASTEST_S * (1 - 1e-9) <= there <= SLOWEST_S * (1 + 1e-9)
    if 2 * FASTEST_S < shape < SLOWEST_S / 2 and abs(step) < 0.5:
        assert taken == step


@pytest.mark.parametrize(("shape", "step"), [(0.2, -3.0), (9 * 3600.0, 3.0)])
def test_a_shape_beyond_the_ends_goes_no_further(mass, shape: float, step: float) -> None:
    """A grid of them may begin there: it is no fault, and the way back is free."""
    effect = replace(mass, candidate=mass.candidate.reshaped(shape))
    assert within(effect, EffectParameter(0, Kind.SHAPE), step, PERIOD_S) == 0.0
    assert within(effect, EffectParameter(0, Kind.SHAPE), -step, PERIOD_S) == pytest.approx(-np.sign(step) * 0.5)


def test_a_clock_that_is_early_keeps_its_sign(chain, record) -> None:
    clock = chain.effect(record, "clock_offset", (1.0,), shape=-60.0)
    assert moved(clock, EffectParameter(0, Kind.SHAPE), 0.1).candidate.shape == pytest.approx(-60.0 * np.exp(0.1))


@given(onset_s=st.floats(0, 2000), lasts_s=st.floats(30, 2000), steps=st.tuples(STEPS, STEPS))
@settings(max_examples=200, deadline=None)
def test_edges_move_by_little_and_leave_a_window(coupling, onset_s: float, lasts_s: float, steps) -> None:
    effect = replace(coupling, onset_s=onset_s, end_s=onset_s + lasts_s)
    after = effect
    for kind, step in zip((Kind.ONSET, Kind.END), steps):
        taken = within(effect, EffectParameter(0, kind), step, PERIOD_S)
        assert abs(taken) <= min(1.5 * PERIOD_S, abs(step))
        assert taken * step >= 0.0
        after = moved(after, EffectParameter(0, kind), taken)
    # both at once, as one step moves them
    assert after.end_s - after.onset_s >= min(lasts_s, 3 * PERIOD_S) - 1e-6


@given(step=STEPS)
@settings(max_examples=50, deadline=None)
def test_a_lonely_edge_moves_by_one_and_a_half_samples_at_most(mass, step: float) -> None:
    taken = within(mass, EffectParameter(0, Kind.ONSET), step, PERIOD_S)
    assert taken == pytest.approx(np.clip(step, -15.0, 15.0))
    assert moved(mass, EffectParameter(0, Kind.ONSET), taken).onset_s == pytest.approx(605.0 + taken)


def test_what_is_free(chain, record, coupling, mass) -> None:
    contact = chain.effect(record, "contact at shell", (0.2, 2.0))
    lag = chain.effect(record, "sensor_lag at board", (1.0,), None, 1605.0)
    whole = Model(chain.plant(), (contact, replace(mass, known=True), lag, coupling))
    mine = (EffectParameter(0, Kind.COEFFICIENT, 0), EffectParameter(0, Kind.COEFFICIENT, 1))
    rest = (
        EffectParameter(2, Kind.SHAPE), EffectParameter(2, Kind.END),
        EffectParameter(3, Kind.COEFFICIENT), EffectParameter(3, Kind.ONSET), EffectParameter(3, Kind.END),
    )  # fmt: skip
    assert unknowns(whole, known=False) == (*mine, *rest)
    assert unknowns(whole, known=True) == (*mine, EffectParameter(1, Kind.COEFFICIENT), *rest)
    seen = replace(coupling, candidate=replace(coupling.candidate, window=(605.0, 1605.0)))
    assert unknowns(Model(chain.plant(), (seen,)), known=False) == (EffectParameter(0, Kind.COEFFICIENT),)


@pytest.mark.parametrize("kind", list(Kind))
def test_a_small_step_is_within_and_moves_nothing_else(mass, kind: Kind) -> None:
    effect = replace(mass, end_s=1605.0)
    unknown = EffectParameter(0, kind)
    step = small_step(unknown, PERIOD_S)
    assert within(effect, unknown, step, PERIOD_S) == pytest.approx(step)
    after = moved(effect, unknown, step)

    def numbers(each: Effect) -> np.ndarray:
        return np.array([each.values[0], np.log(each.candidate.shape), each.onset_s, each.end_s])

    change = numbers(after) - numbers(effect)
    np.testing.assert_allclose(change, step * np.eye(4)[list(Kind).index(kind)], atol=1e-9)
    back = moved(after, unknown, -step)
    np.testing.assert_allclose(numbers(back), numbers(effect), rtol=1e-12)
    assert effect.values[0] == 0.2


def test_what_has_no_shape_has_none_to_move(coupling) -> None:
    with pytest.raises(ValueError, match="an effect without a shape has none to move"):
        moved(coupling, EffectParameter(0, Kind.SHAPE), 0.1)
