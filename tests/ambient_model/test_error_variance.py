"""The spread's rule against its equations summed out, term by term, over whole sequences."""

import itertools

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from ambient_model.error_variance import advanced, gains, initial_state, sigma_degC
from ambient_model.model import ErrorVariance, Term

QUANTILES = {50: (-0.7, 0.7), 90: (-1.6, 1.6), 98: (-2.3, 2.3)}


def low_pass(z: np.ndarray, time_s: np.ndarray, lag_s: float) -> np.ndarray:
    """Each value a sum over all before it: what came in at j has decayed by exp(-(t_k - t_j) / lag) since."""
    kept = np.exp(-np.abs(time_s[:, None] - time_s[None, :]) / lag_s)
    entered = np.concatenate([[1.0], -np.expm1(-np.diff(time_s) / lag_s)])
    return np.tril(kept * entered) @ z


def sigmas(spread: ErrorVariance, time_s: np.ndarray, y: np.ndarray, d: np.ndarray) -> np.ndarray:
    variance = np.full(len(y), spread.constant_degC2)
    for term in spread.terms:
        z = {
            "movement": (y - low_pass(y, time_s, term.lag_s)) ** 2,
            "guard": d**2,
        }[term.of]
        variance = variance + term.weight * low_pass(z, time_s, term.lag_s)
    return np.sqrt(variance)


def followed_through(spread: ErrorVariance, time_s: np.ndarray, y: np.ndarray, d: np.ndarray) -> list[float]:
    unrest = initial_state(spread, y[0], d[0])
    said = [sigma_degC(spread, unrest)]
    for (before_s, now_s), ambient, apart in zip(itertools.pairwise(time_s.tolist()), y.tolist()[1:], d.tolist()[1:]):
        unrest = advanced(spread, unrest, gains(spread, now_s - before_s), ambient, apart)
        said.append(sigma_degC(spread, unrest))
    return said


terms = st.builds(Term, st.sampled_from(["movement", "guard"]), st.floats(0.1, 1e4), st.floats(0, 20))
spreads = st.builds(ErrorVariance, st.floats(0, 4), st.lists(terms, max_size=5).map(tuple), st.just(QUANTILES))


@given(spreads, st.integers(1, 60), st.integers(0, 2**32 - 1))
def test_any_spread_over_any_sequence(spread: ErrorVariance, count: int, seed: int) -> None:
    random = np.random.default_rng(seed)
    time_s = np.cumsum(random.choice([0.1, 1.0, 1.0, 25.0], count))
    y, d = random.normal(20, 5, count), random.normal(0, 2, count)
    np.testing.assert_allclose(followed_through(spread, time_s, y, d), sigmas(spread, time_s, y, d), rtol=0, atol=1e-9)
