"""Structures that can be fitted: outputs linear in some unknowns beta and nonlinear in the others, theta.

y_o = f_o(theta) + sum_i beta_i F_oi(theta)

Those that enter linearly are solved for exactly inside the search (variable projection). For min |t - F(theta) beta|
the best beta is F^+ t, the residual rho = P t with P = I - F F^+, and, with d the slopes of the outputs at that beta
(Kaufman, BIT 15, 1975),

    d rho = -P d.

What this leaves of the derivative (Golub and Pereyra, SIAM J. Numer. Anal. 10(2), 1973) is orthogonal to rho: the
gradient is exact. Where bounds hold some of beta, those columns count as known.

Samples enter by inner products alone. So no residual of N samples goes into the search: QR factorisations shrink t, F
and d to as many rows as they are columns.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dgeqrf
from scipy.optimize import lsq_linear

from ambient_trainer.data import Array, Segment

_RANK_TOLERANCE = 1e-11
_BLOCK_SAMPLES = 2048
LONGEST_STEP = 2.0
"""Of a logarithm, in one evaluation: it should not leap."""


@dataclass(frozen=True)
class Unknowns:
    """Names, bounds and starting values of a set of unknowns, each of shape (count,)."""

    names: tuple[str, ...]
    initial: Array
    low: Array
    high: Array
    longest_step: Array | float = LONGEST_STEP

    def at_bound(self, values: Array) -> NDArray[np.bool_]:
        """Which of ``values`` (count,) lie within a millionth of the span of a bound."""
        span = np.where(np.isfinite(self.high - self.low), self.high - self.low, 1.0)
        return (values <= self.low + 1e-6 * span) | (values >= self.high - 1e-6 * span)


class Structure(ABC):
    """What the search needs to know of a model; by default of one without penalty and with one meaning a theta."""

    search: Unknowns
    """theta, in the coordinates of the search."""
    linear: Unknowns
    """beta; ``initial`` is not used."""
    segments: Sequence[Segment]

    @abstractmethod
    def regressors(self, theta: Array, index: int) -> tuple[Array, Array]:
        """The outputs of segment ``index`` with beta = 0, (q, N), and what each of beta adds to them, (p, q, N)."""

    @abstractmethod
    def slopes(self, theta: Array, beta: Array, index: int) -> Array:
        """The outputs' derivatives in theta, (P, q, N)."""

    @abstractmethod
    def random_start(self, random: np.random.Generator) -> Array:
        """Another theta to start from, within the bounds."""

    def penalty(self, theta: Array) -> tuple[Array, Array]:
        """By how much theta leaves what is plausible: (c,), zero where it does not, and its Jacobian (c, P)."""
        return np.zeros(0), np.zeros((0, len(theta)))

    def regrouped(self, theta: Array) -> Array:
        """The same point in better coordinates, where there are any; else theta itself."""
        return theta

    def predicted(self, theta: Array, beta: Array, index: int) -> Array:
        """The outputs (q, N) of segment ``index``."""
        fixed, free = self.regressors(theta, index)
        return np.asarray(fixed + np.tensordot(beta, free, 1))


class Linearised(NamedTuple):
    """The least-squares problem about theta and beta, in r compressed rows: target ~ free beta + slopes dtheta.

    beta (p,), which of it no bound holds (``loose``), target (r,), free (r, p) and slopes (r, P).
    """

    beta: Array
    loose: NDArray[np.bool_]
    target: Array
    free: Array
    slopes: Array


class Projection(NamedTuple):
    """The residual (r,) and its Jacobian (r, P) at a point; of a structure in compressed rows, with beta (p,)."""

    residual: Array
    jacobian: Array
    beta: Array = np.zeros(0)


def project(structure: Structure, theta: Array) -> Projection:
    """Solve for the linear unknowns within their bounds and differentiate what is left."""
    beta, loose, target, free, slopes = linearise(structure, theta)
    U, _ = _pseudo_inverse(free[:, loose])
    return Projection(target - free @ beta, U @ (U.T @ slopes) - slopes, beta)


def linearise(structure: Structure, theta: Array, beta: Array | None = None) -> Linearised:
    """The compressed problem of ``structure`` at ``theta`` over all its segments; by default at the best beta."""
    p, known = len(structure.linear.names), [~np.isnan(each.outputs) for each in structure.segments]
    tables = []
    for index, segment in enumerate(structure.segments):
        fixed, free = structure.regressors(theta, index)
        tables.append(np.concatenate([_at(known[index], free), _at(known[index], (segment.outputs - fixed)[None])]))
    loose = np.ones(p, dtype=bool)
    if beta is None:
        R = _triangle(tables)
        beta, loose = _solved(R[:, :p], R[:, p], structure.linear)
    slopes = (_at(known[index], structure.slopes(theta, beta, index)) for index in range(len(tables)))
    R = _triangle(np.concatenate(each) for each in zip(tables, slopes))
    return Linearised(beta, loose, R[:, p], R[:, :p], R[:, p + 1 :])


def _at(known: NDArray[np.bool_], rows: Array) -> Array:
    """The rows (c, q, N) at the samples of all outputs that are ``known``, (c, K)."""
    return rows.reshape(len(rows), known.size) if known.all() else rows[:, known]


def _triangle(tables: Iterable[Array]) -> Array:
    """The R of a QR factorisation of tables (c, N), transposed: c rows with the same inner products.

    In blocks of samples that stay in the cache, and without the columns that are zero in a segment.
    """
    triangles = []
    for table in tables:
        used = np.flatnonzero(table.any(axis=1))
        rows, upper = table[used], np.tri(len(used), dtype=bool).T
        for start in range(0, rows.shape[1], _BLOCK_SAMPLES):
            # the transpose has the columns where LAPACK wants them: nothing is copied
            packed, _, _, _ = dgeqrf(rows[:, start : start + _BLOCK_SAMPLES].copy().T, overwrite_a=1)
            triangle = np.zeros((min(packed.shape), len(table)))
            triangle[:, used] = packed[: len(triangle)] * upper[: len(triangle)]
            triangles.append(triangle)
    return np.asarray(np.linalg.qr(np.concatenate(triangles), mode="r"))


def _solved(free: Array, target: Array, bounds: Unknowns) -> tuple[Array, NDArray[np.bool_]]:
    """The best beta (p,) within ``bounds``, and which of it no bound holds."""
    beta = _pseudo_inverse(free)[1] @ target
    if ((beta >= bounds.low) & (beta <= bounds.high)).all():
        return beta, np.ones(len(beta), dtype=bool)
    solution = lsq_linear(free, target, (bounds.low, bounds.high), method="bvls")
    held, loose = solution.active_mask, solution.active_mask == 0
    beta = np.where(held < 0, bounds.low, np.where(held > 0, bounds.high, solution.x))
    # what the bounds leave loose is solved exactly, so that the derivative above is that of the solution
    _, inverse = _pseudo_inverse(free[:, loose])
    beta[loose] = np.clip(inverse @ (target - free[:, ~loose] @ beta[~loose]), bounds.low[loose], bounds.high[loose])
    return beta, loose


def _pseudo_inverse(F: Array) -> tuple[Array, Array]:
    """An orthonormal basis of the columns (r, k) and the pseudo-inverse (p, r)."""
    if not F.shape[1]:
        return np.zeros((F.shape[0], 0)), np.zeros((0, F.shape[0]))
    scale = np.linalg.norm(F, axis=0)
    scale[scale == 0] = 1.0
    U, singular, Vt = np.linalg.svd(F / scale, full_matrices=False)
    kept = singular > _RANK_TOLERANCE * singular[0]
    return U[:, kept], (Vt[kept].T / singular[kept]) @ U[:, kept].T / scale[:, None]
