"""What an effect is worth: blocks, intervals and p-values against their own definitions, and chance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from ambient_trainer.diagnosis.fit import FitResult, blocks
from ambient_trainer.diagnosis.gain import Blocks, differ, gain
from ambient_trainer.diagnosis.model import view

N = 1000


def _fitted(chain, errors: np.ndarray) -> FitResult:
    """As if these were the held-out errors of a record."""
    inputs = chain.inputs(errors.shape[1])
    seen = view(chain.model(), chain.record(inputs, np.full(errors.shape, 20.0)))
    return FitResult(chain.model(), (seen,), (errors,), 0.0)


def _made(white: np.ndarray, square: np.ndarray, count: float = 20.0) -> Blocks:
    return Blocks(white, square[:, None], np.full((len(white), 1), count))


def test_blocks_add_up(chain) -> None:
    errors = 0.1 * np.random.default_rng(1).standard_normal((3, N))
    errors[2, 300:340] = np.nan
    noise = chain.noise(0.1)
    found = Blocks.of(_fitted(chain, errors), noise)
    seen = _fitted(chain, errors).views[0]
    block = blocks(seen.record)
    assert len(found.white) == block[-1] + 1
    assert found.count.sum() == (~np.isnan(errors)).sum()
    np.testing.assert_allclose(found.square_degC2[3], np.nansum(errors[:, block == 3] ** 2, axis=1))
    assert found.white.sum() == pytest.approx(np.nansum(noise.white(errors) ** 2))
    assert found.rmse_degC() == pytest.approx(np.sqrt(np.nanmean(errors**2)))
    uneven = replace(noise, deviation_degC=np.array([0.1, 0.2, 0.4]))
    wanted = np.sqrt(np.nansum((errors / uneven.deviation_degC[:, None]) ** 2) / (~np.isnan(errors)).sum())
    assert found.relative(uneven) == pytest.approx(wanted)


def test_a_gain_is_the_fall_of_the_rmse(chain) -> None:
    random = np.random.default_rng(2)
    worse, better = 0.3 * random.standard_normal((3, N)), 0.1 * random.standard_normal((3, N))
    noise = chain.noise(0.1)
    before, after = (Blocks.of(_fitted(chain, each), noise) for each in (worse, better))
    found = gain(before, after, 1.0, 10)
    assert found.rmse_before_degC == pytest.approx(np.sqrt(np.mean(worse**2)))
    assert found.rmse_after_degC == pytest.approx(np.sqrt(np.mean(better**2)))
    assert found.ci95_degC[0] < found.rmse_before_degC - found.rmse_after_degC < found.ci95_degC[1]
    assert found.p_value < 1e-12
    back = gain(after, before, 1.0, 10)
    assert back.p_value == 1.0
    assert back.ci95_degC == pytest.approx((-found.ci95_degC[1], -found.ci95_degC[0]))


def test_the_interval_covers_the_true_gain() -> None:
    """Of many draws of fifty blocks, about 95 % of the intervals hold the gain of endlessly many."""
    truth, covered = np.sqrt(0.04) - np.sqrt(0.02), 0
    for seed in range(200):
        random = np.random.default_rng(seed)
        old, new = (s * random.chisquare(20, 50) for s in (0.04, 0.02))
        low, high = gain(_made(old, old), _made(new, new), 1.0, 1).ci95_degC
        covered += low < truth < high
    assert 0.90 <= covered / 200 <= 0.99


@pytest.mark.parametrize("unknowns", [1, 3])
def test_chance_is_seldom_significant(unknowns: int) -> None:
    """Columns fitted to white noise: what they explain of it is chi-squared, and the p-value about uniform."""
    found = []
    for seed in range(400):
        random = np.random.default_rng(seed)
        rows, X = random.standard_normal(1000), random.standard_normal((1000, unknowns))
        left = rows - X @ np.linalg.lstsq(X, rows, rcond=None)[0]
        before, after = ((each**2).reshape(50, 20).sum(axis=1) for each in (rows, left))
        found.append(gain(_made(before, before), _made(after, after), float(unknowns), 1).p_value)
    for level in (0.01, 0.05, 0.2, 0.5):
        share = np.mean(np.array(found) < level)
        assert abs(share - level) < 4 * np.sqrt(level * (1 - level) / 400) + 0.02


def test_the_p_value_counts_the_candidates() -> None:
    before, after = np.full(50, 20.0), np.full(50, 20.0)
    before[0] += 18.0
    one, many = (gain(_made(before, before), _made(after, after), 2.0, tries) for tries in (1, 100))
    assert one.p_value == pytest.approx(chi2.sf(18.0, 2))
    assert many.p_value == pytest.approx(100 * one.p_value)
    assert gain(_made(before, before), _made(after, after), 2.0, 10**9).p_value == 1.0


def test_a_p_value_knows_when_the_noise_was_taken_too_small() -> None:
    """Squares four times what they should be: the fall counts a quarter."""
    before, after = np.full(50, 80.0), np.full(50, 80.0)
    before[0] += 72.0
    assert gain(_made(before, before), _made(after, after), 2.0, 1).p_value == pytest.approx(chi2.sf(18.0, 2))


def test_the_same_twice_is_the_same_number() -> None:
    random = np.random.default_rng(3)
    old, new = random.chisquare(20, 50), random.chisquare(19, 50)
    assert gain(_made(old, old), _made(new, new), 1.0, 1) == gain(_made(old, old), _made(new, new), 1.0, 1)


def test_differ_is_a_paired_t() -> None:
    random = np.random.default_rng(4)
    one, other = random.chisquare(20, 50) + 2.0, random.chisquare(20, 50)
    t = np.mean(one - other) / (np.std(one - other, ddof=1) / np.sqrt(50))
    assert differ(_made(one, one), _made(other, other)) == pytest.approx(t)
    assert differ(_made(other, other), _made(one, one)) == pytest.approx(-t)
    assert differ(_made(one, one), _made(one, one)) == 0.0
