"""Two filters in series against themselves, run one after the other, however close their poles lie."""

from __future__ import annotations

import numpy as np
import pytest

from ambient_trainer.lti.modes import Pairs, one_pole

PERIOD_S = 0.5


@pytest.mark.parametrize("apart", [0.0, 1e-12, 1e-6, 0.99e-3, 1.01e-3, 0.1, 3.0, 1e3])
@pytest.mark.parametrize("rate_per_s", [-1e-7, -1e-3, -0.3, -20.0])
def test_a_pair_is_its_own_signal_or_two_single_ones(rate_per_s, apart):
    rates = np.array([rate_per_s, rate_per_s * (1 + apart)])
    poles = np.exp(rates * PERIOD_S)
    pairs = Pairs.of(poles)
    u = 25 + np.cumsum(np.random.default_rng(0).normal(size=(1, 4000)), axis=1)
    single = [one_pole(a, u, u[:, 0] / (1 - a))[0] for a in poles]
    series = np.zeros((2, 2))
    series[0, 1] = 1.0
    own, quotients = pairs.parted(series)
    expected = one_pole(poles[0], single[1][None], single[1][:1] / (1 - poles[0]))[0]
    signals = [
        one_pole(poles[i], single[k][None], single[k][:1] / (1 - poles[i]))[0] for i, k in np.argwhere(pairs.own)
    ]
    found = own @ np.array(signals) + quotients[0, 1] * (single[0] - single[1])
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9 * np.abs(expected).max())


def test_only_what_lies_close_needs_a_signal_of_its_own():
    pairs = Pairs.of(np.exp([-0.001, -0.00100001, -0.1]))
    np.testing.assert_array_equal(pairs.own, [[True, True, False], [True, True, False], [False, False, True]])
    assert pairs.count == 5
    assert Pairs.of(np.zeros(0)).count == 0


def test_modes_that_are_gone_before_the_next_sample_lie_close():
    """Both poles are zero to rounding, however different the rates."""
    assert Pairs.of(np.exp([-50.0, -500.0])).own.all()
