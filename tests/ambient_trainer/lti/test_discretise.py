"""Discretisation is exact: against an integrator, against scipy, against differences."""

import numpy as np
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.signal import cont2discrete

from ambient_trainer.lti.discretise import discretised, discretised_slopes
from ambient_trainer.lti.statespace import StateSpace

MATRICES = ("A", "B", "C", "D", "offset")


def _system(A, m=2, q=2, seed=0):
    random = np.random.default_rng(seed)
    others = (random.normal(size=shape) for shape in ((len(A), m), (q, len(A)), (q, m), q))
    return StateSpace(np.array(A, dtype=float), *others)


def test_without_states_it_is_the_static_map():
    found = discretised(_system(np.zeros((0, 0))), 1.0, "first-order")
    assert (found.A.shape, found.B.shape, found.C.shape) == ((0, 0), (0, 2), (2, 0))
    np.testing.assert_array_equal(found.D, _system(np.zeros((0, 0))).D)


@st.composite
def stable_systems(draw):
    """Random systems with real, repeated or complex poles, all in the left half plane and up to 1e4 apart."""
    n = draw(st.integers(1, 4))
    random = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    rates = [draw(st.floats(1e-3, 10)) for _ in range(n)]
    if n > 1 and draw(st.booleans()):
        rates[1] = rates[0]
    triangle = np.triu(random.normal(size=(n, n)), 1) * draw(st.sampled_from([0, 0.1, 1])) - np.diag(rates)
    if n > 1 and draw(st.booleans()):  # a damped pair
        triangle[:2, :2] = [[-rates[0], 1.0], [-1.0, -rates[0]]]
    Q = np.linalg.qr(random.normal(size=(n, n)))[0]
    return _system(Q @ triangle @ Q.T, m=draw(st.integers(1, 3)), q=draw(st.integers(1, 2)), seed=n)


def _markov(discrete, count):
    found, x = [discrete.D], discrete.B
    for _ in range(count):
        found.append(discrete.C @ x)
        x = discrete.A @ x
    return np.array(found)


@given(stable_systems(), st.sampled_from([0.1, 0.5, 1.0, 10.0]))
@example(_system([[-0.5, 1.0, 0.0], [0.0, -0.5, 1.0], [0.0, 0.0, -0.5]]), 7.0)  # defective
@example(_system([[-200.0, 1.0], [0.5, -0.001]]), 1.0)  # stiff
def test_its_response_is_that_of_scipy(system, period_s):
    for method, hold in (("zoh", "zero-order"), ("foh", "first-order")):
        A, B, C, D, _ = cont2discrete((system.A, system.B, system.C, system.D), period_s, method=method)
        wanted = _markov(StateSpace(A, B, C, D, system.offset), 8)
        found = _markov(discretised(system, period_s, hold), 8)
        np.testing.assert_allclose(found, wanted, rtol=1e-7, atol=1e-9 * np.abs(wanted).max())


@given(stable_systems())
def test_one_equilibrium_serves_every_period_and_hold(system):
    X0 = -np.linalg.solve(system.A, system.B)
    gain = system.D + system.C @ X0
    for period_s in (0.1, 0.2, 0.5, 1.0, 10.0):
        for hold in ("zero-order", "first-order"):
            found = discretised(system, period_s, hold)
            scale = np.abs(X0).max()
            np.testing.assert_allclose(X0 - found.A @ X0, found.B, rtol=1e-9, atol=1e-11 * scale)
            np.testing.assert_allclose(found.D + found.C @ X0, gain, rtol=1e-9, atol=1e-10 * scale)


@settings(max_examples=30)
@given(stable_systems(), st.sampled_from([0.1, 1.0, 10.0]), st.sampled_from(["zero-order", "first-order"]))
def test_slopes_are_those_of_differences(system, period_s, hold):
    random = np.random.default_rng(7)
    # along the last direction A stands still
    still = np.array([1.0, 1.0, 0.0])
    dA, dB, dC, dD, doffset = (
        random.normal(size=(3, *np.shape(getattr(system, each)))) * (still.reshape(3, 1, 1) if each == "A" else 1.0)
        for each in MATRICES
    )
    directions = StateSpace(dA, dB, dC, dD, doffset)
    found = discretised_slopes(system, directions, period_s, hold)
    h = 1e-4 / max(1.0, period_s)
    for index in range(3):

        def along(step, index=index):
            systems = (
                StateSpace(*(getattr(system, each) + s * getattr(directions, each)[index] for each in MATRICES))
                for s in (step, -step)
            )
            moved = [discretised(each, period_s, hold) for each in systems]
            return {each: (getattr(moved[0], each) - getattr(moved[1], each)) / (2 * step) for each in MATRICES}

        fine, coarse = along(h), along(2 * h)
        for each in MATRICES:
            wanted = (4 * fine[each] - coarse[each]) / 3
            scale = np.abs(wanted).max(initial=1.0)
            np.testing.assert_allclose(getattr(found, each)[index], wanted, rtol=1e-6, atol=1e-7 * scale, err_msg=each)
