"""A residual's memory is found and taken out."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from ambient_trainer.estimation.noise import LEAK, ORDER, Noise

AR = np.array([0.7, -0.2, 0.15, 0.1])


def _remembering(seed: int, count: int, deviation: float = 0.1) -> np.ndarray:
    innovation = deviation * np.random.default_rng(seed).standard_normal(count + 500)
    return lfilter([1.0], [1.0, *-AR], innovation)[500:]


def test_a_known_autoregression_is_recovered() -> None:
    rows = np.stack([_remembering(1, 40000), 2.0 * _remembering(2, 40000)])
    noise = Noise.of([rows])
    for memory in noise.memory:
        np.testing.assert_allclose(memory, AR * LEAK ** np.arange(1, ORDER + 1), atol=0.02)
    np.testing.assert_allclose(noise.deviation_degC, rows.std(axis=1), rtol=0.02)
    # the leak costs a little: less is taken out than could be
    assert 0.1 <= noise.innovation_degC[0] < 0.11
    assert noise.innovation_degC[1] == pytest.approx(2 * noise.innovation_degC[0], rel=0.03)


def test_whitened_rows_have_unit_variance_and_little_memory() -> None:
    rows = np.stack([_remembering(3, 20000), 5 * _remembering(4, 20000)])
    white = Noise.of([rows]).white(rows)
    assert white.shape == (2, 20000 - ORDER)
    np.testing.assert_allclose(white.std(axis=1), 1.0, rtol=1e-3)
    before = np.mean(rows[0, 1:] * rows[0, :-1]) / np.mean(rows[0] ** 2)
    after = np.mean(white[0, 1:] * white[0, :-1])
    assert before > 0.5
    assert abs(after) < 0.2


def test_whitening_is_the_difference_equation_written_out() -> None:
    noise = Noise(np.array([[0.5, 0.1, 0.0, -0.2]]), np.array([0.25]), np.array([1.0]))
    row = np.random.default_rng(5).normal(size=(3, 1, 12))
    white = noise.white(row)
    for batch in range(3):
        for k in range(ORDER, 12):
            e = row[batch, 0]
            wanted = (e[k] - 0.5 * e[k - 1] - 0.1 * e[k - 2] + 0.2 * e[k - 4]) / 0.25
            assert white[batch, 0, k - ORDER] == pytest.approx(wanted)


def test_records_are_not_joined_across_their_ends() -> None:
    """The same normal equations as of every record's own windows, and none that spans two."""
    one, two = _remembering(6, 300), 5.0 + _remembering(7, 400)
    windows = [row[k : k + ORDER + 1] for row in (one, two) for k in range(len(row) - ORDER)]
    past, now = np.array(windows)[:, ORDER - 1 :: -1], np.array(windows)[:, ORDER]
    memory, *_ = np.linalg.lstsq(past, now, rcond=None)
    noise = Noise.of([one[None], two[None]])
    np.testing.assert_allclose(noise.memory[0], memory * LEAK ** np.arange(1, ORDER + 1), atol=5e-3)
    assert noise.innovation_degC[0] == pytest.approx(np.sqrt(np.mean((now - past @ noise.memory[0]) ** 2)))


def test_missing_samples_spoil_only_what_they_touch() -> None:
    row = _remembering(8, 5000)[None]
    holed = row.copy()
    holed[0, 1000:1010] = np.nan
    full, part = Noise.of([row]), Noise.of([holed])
    np.testing.assert_allclose(part.memory, full.memory, atol=0.01)
    white = part.white(holed)
    assert np.isnan(white).sum() == 10 + ORDER
    assert np.isfinite(white[0, : 1000 - ORDER]).all()
    assert np.isfinite(white[0, 1010:]).all()


def test_nothing_known_is_noise_of_a_degree() -> None:
    noise = Noise.of([np.full((2, 100), np.nan), np.ones((2, 3))])
    np.testing.assert_array_equal(noise.memory, np.zeros((2, ORDER)))
    np.testing.assert_array_equal(noise.innovation_degC, [1.0, 1.0])


def test_a_perfect_simulation_is_no_better_than_an_instrument() -> None:
    noise = Noise.of([np.zeros((1, 200))])
    assert np.isfinite(noise.memory).all()
    np.testing.assert_array_equal(noise.innovation_degC, [1e-3])
    assert np.isfinite(noise.white(np.zeros((1, 200)))).all()
