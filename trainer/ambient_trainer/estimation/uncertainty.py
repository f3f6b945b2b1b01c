"""Standard errors that are valid for autocorrelated residuals, and parameters that the data do not determine.

The covariance of the unknowns is the sandwich H^-1 (sum_b g_b g_b') H^-1 with H = J'J and g_b the sum of J_t r_t of
all outputs over a batch of samples longer than the residuals remember (batch means: Geyer 1992, Statistical Science
7(4); sandwich: White 1982, Econometrica 50(1)). With white residuals a batch is one sample. Directions in which J is
zero to rounding are named: along them the data say nothing.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import signal, stats

from ambient_trainer.data.trace import Array
from ambient_trainer.estimation.search import Solution
from ambient_trainer.estimation.structure import Structure

_NULL = 1e-8
_INVOLVED = 0.05
_TIMES_PER_BATCH = 2, 8
"""At least, and at most: the longer a batch, the less it correlates with the next, but the fewer there are."""
_SPARE = 20
"""More batches than unknowns are wanted by so many."""
_WHITE = 1.3


@dataclass(frozen=True)
class Uncertainty:
    """How well each unknown is known; theta first, then beta.

    ``standard_error`` (count,) is in the coordinates of the search, NaN where it is open; ``quantile`` makes half a
    95 % interval of it. ``confounded`` has the unknowns of each direction that the data say nothing about.
    """

    names: tuple[str, ...]
    standard_error: Array
    quantile: float
    at_bound: NDArray[np.bool_]
    identifiable: NDArray[np.bool_]
    confounded: tuple[tuple[str, ...], ...]
    residual_memory_samples: float


def residuals(structure: Structure, solution: Solution) -> list[Array]:
    """Per segment the residuals (q, N) in degC, NaN where there is nothing to compare with."""
    theta, beta = solution.theta, solution.beta
    return [each.outputs - structure.predicted(theta, beta, index) for index, each in enumerate(structure.segments)]


def uncertainty(structure: Structure, solution: Solution) -> Uncertainty:
    """The uncertainty of every unknown at ``solution``."""
    rows, errors = _rows(structure, solution)
    names = (*structure.search.names, *structure.linear.names)
    at_bound = np.append(structure.search.at_bound(solution.theta), structure.linear.at_bound(solution.beta))
    loose = np.flatnonzero(~at_bound)
    J = np.concatenate([each[loose].reshape(len(loose), each[0].size).T for each in rows])
    scale = np.linalg.norm(J, axis=0)
    insensitive = scale == 0
    scale[insensitive] = 1.0
    _, singular, Vt = np.linalg.svd(np.linalg.qr(J / scale, mode="r"))
    kept = singular > _NULL * singular[0] if len(singular) else singular.astype(bool)
    null_directions = Vt[~kept]
    known = ~insensitive & ((null_directions**2).sum(axis=0) < _INVOLVED**2)
    inverse = (Vt[kept].T / singular[kept]) @ (Vt[kept] / singular[kept][:, None]) / np.outer(scale, scale)
    outputs = [row[~np.isnan(row)] for each in errors for row in each]
    correlation_samples = max((autocorrelation_time(each) for each in outputs if len(each)), default=1.0)
    samples = sum(each.shape[1] for each in errors)
    batch_times = np.clip(samples / correlation_samples / (len(loose) + _SPARE), *_TIMES_PER_BATCH)
    batch = 1 if correlation_samples < _WHITE else math.ceil(batch_times * correlation_samples)
    slopes = [np.einsum("kqn,qn->nk", J_t[loose], np.nan_to_num(r)) for J_t, r in zip(rows, errors) if r.size]
    scores = np.concatenate([np.add.reduceat(s, np.arange(0, len(s), batch), axis=0) for s in slopes])
    spare = len(scores) - len(loose)
    standard_error = np.full(len(names), np.nan)
    if spare >= 5:
        # neighbouring batches share half an autocorrelation time, which lacks in the batches' variance
        short = batch / (batch - correlation_samples / 2) if batch > 1 else 1.0
        covariance = inverse @ (scores.T @ scores) @ inverse * (short * len(scores) / spare)
        standard_error[loose] = np.where(known, np.sqrt(np.diag(covariance)), np.nan)
    identifiable = np.ones(len(names), dtype=bool)
    identifiable[loose] = known
    involved = [loose[np.abs(direction) > _INVOLVED] for direction in null_directions]
    confounded = tuple(tuple(names[k] for k in each) for each in involved)
    quantile = float(stats.t.ppf(0.975, max(spare, 1)))
    return Uncertainty(names, standard_error, quantile, at_bound, identifiable, confounded, correlation_samples)


def autocorrelation_time(errors: Array) -> float:
    """The integrated autocorrelation time of ``errors`` (N,) in samples, by Geyer's initial positive sequence."""
    centred = errors - errors.mean()
    count = len(centred)
    correlation = signal.correlate(centred, centred, method="fft")[count - 1 :]
    if correlation[0] <= 0:
        return 1.0
    pairs = (correlation[: count // 2 * 2] / correlation[0]).reshape(-1, 2).sum(axis=1)
    ends = np.flatnonzero(pairs <= 0)
    return float(max(1.0, 2 * pairs[: ends[0] if len(ends) else len(pairs)].sum() - 1))


def _rows(structure: Structure, solution: Solution) -> tuple[list[Array], list[Array]]:
    """Per segment the Jacobian (count, q, N) of the outputs in all unknowns, zero where there is nothing to compare
    with, and the errors (q, N), NaN there; N are the samples with any."""
    rows, errors = [], []
    for index, each in enumerate(residuals(structure, solution)):
        seen = ~np.isnan(each).all(axis=0)
        _, free = structure.regressors(solution.theta, index)
        slopes = structure.slopes(solution.theta, solution.beta, index)
        errors.append(each[:, seen])
        rows.append(np.where(np.isnan(errors[-1]), 0.0, np.concatenate([slopes, free])[..., seen]))
    return rows, errors
