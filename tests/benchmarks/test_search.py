"""How long the search over a phone's zones takes, and a candidate by its Gram matrices beside a refit from scratch."""

import time

import numpy as np
import pytest
from scipy.linalg import lstsq

from ambient_trainer.selection.grams import gathered, low_passes, noise_gram
from ambient_trainer.selection.screen import screened
from ambient_trainer.selection.search import Options, numbered, prepared
from ambient_trainer.simulator import simulate

POLES_S = (10.0, 30.0, 90.0, 270.0)
FIVE = ("soc", "flash", "battery", "usb", "display")


@pytest.fixture(scope="module")
def trace():
    return simulate("5", seed=0, all_zones=True).trace


@pytest.mark.benchmark(group="candidate")
def test_a_candidate_beside_its_refit_from_scratch(trace, benchmark, noted):
    """Four of the thesis's sensors with each other zone: the same sums of squares both ways."""
    options = Options()
    data = prepared([trace], *screened([trace]), options)
    grams = gathered(data.segments, data.blocks, data.sensors, POLES_S, options.tolerance_degC)
    four = numbered(data, FIVE[1:])
    sets = [tuple(sorted((*four, each))) for each in range(len(data.sensors)) if each not in four]
    squares = benchmark.pedantic(grams.squares, args=(sets,), rounds=5, iterations=1)
    ours_s = benchmark.stats.stats.min / len(sets)
    checked = (0, len(sets) - 1)
    started_s = time.perf_counter()
    scratch = [_refitted(data, sets[k], options.tolerance_degC) for k in checked]
    theirs_s = (time.perf_counter() - started_s) / len(checked)
    task = f"one set of 5 sensors, {len(data.blocks)} blocks held out"
    noted(task, "Gram matrices", ours_s, f"in a batch of {len(sets)}")
    noted(task, "scipy lstsq on raw regressors", theirs_s, f"the same to 1e-6, {theirs_s / ours_s:.0f} times as long")
    np.testing.assert_allclose(squares[list(checked)], scratch, rtol=1e-6)


def _refitted(data, members, tolerance_degC):
    """Per block the sum of squares of a fit to the other samples, each from its raw regressors."""
    segment = data.segments[0]
    count = segment.inputs.shape[1]
    X = low_passes(segment.inputs[list(members)], POLES_S, segment.period_s).reshape(-1, count).T
    y = segment.outputs[0]
    noisy = np.kron(np.eye(len(members)), tolerance_degC * np.linalg.cholesky(noise_gram(POLES_S, segment.period_s)).T)
    still = [np.hypot(tolerance_degC, data.sensors[each].step_degC / np.sqrt(12)) for each in members]
    penalty = np.concatenate([noisy, np.kron(np.diag(still), np.ones((1, 1 + len(POLES_S))))])
    squares = []
    for block in data.blocks:
        teach = np.r_[0 : block.first, block.last : count]
        A = np.concatenate([X[teach], np.sqrt(len(teach)) * penalty])
        one = np.r_[np.ones(len(teach)), np.zeros(len(penalty))]
        # gains that sum to one: the first takes what the others leave
        found = lstsq(np.column_stack([A[:, 1:] - A[:, :1], one]), np.r_[y[teach], np.zeros(len(penalty))] - A[:, 0])[0]
        gains = np.r_[1 - found[:-1].sum(), found[:-1]]
        held = slice(block.start, block.stop)
        squares.append(np.sum((y[held] - X[held] @ gains - found[-1]) ** 2))
    return squares
