"""The bank against scipy's own simulation, its noise Gram against impulse responses."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import cont2discrete, dlsim

from ambient_trainer.selection.grams import banks, low_passes, noise_gram

POLES_S = (3.0, 40.0, 700.0)
T = 2.0


def simulated(tau_s, u):
    """The lag by scipy's first-order hold, from equilibrium with the first sample."""
    lag = (np.array([[each]]) for each in (-1 / tau_s, 1 / tau_s, 1.0, 0.0))
    A, B, C, D, _ = cont2discrete(tuple(lag), T, method="foh")
    _, y, _ = dlsim((A, B, C, D, T), (u - u[0])[:, None])
    return y[:, 0] + u[0]


def test_low_passes_are_those_of_a_first_order_hold():
    u = np.random.default_rng(0).normal(size=(2, 300)).cumsum(axis=1)
    found = low_passes(u, POLES_S, T)
    assert found.shape == (2, 4, 300)
    np.testing.assert_array_equal(found[:, 0], u)
    for row in range(2):
        for k, tau_s in enumerate(POLES_S, start=1):
            np.testing.assert_allclose(found[row, k], simulated(tau_s, u[row]), atol=1e-10)


def test_the_noise_gram_is_that_of_the_impulse_responses():
    impulse = np.zeros((1, 20_000))
    impulse[0, 1] = 1.0
    responses = low_passes(impulse, POLES_S, T)[0]
    np.testing.assert_allclose(noise_gram(POLES_S, T), responses @ responses.T, rtol=1e-9)


@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_every_bank_is_shown_often_enough_by_the_trace(order):
    found = banks(order, 1.0, 20_000.0)
    assert len(set(found)) == len(found) >= 4
    assert all(len(each) == order and each[-1] <= 1000 and list(each) == sorted(each) for each in found)


def test_a_short_trace_gets_the_fastest_bank():
    assert banks(4, 1.0, 100.0) == [(1.0, 3.0, 9.0, 27.0)]
