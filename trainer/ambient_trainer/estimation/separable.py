"""Unknowns that enter linearly are solved for exactly inside the search (variable projection).

For min |t - f(theta) - F(theta) beta| the best beta is beta(theta) = F^+ (t - f), the residual rho = P (t - f) with
P = I - F F^+, and its derivative (Golub and Pereyra, SIAM J. Numer. Anal. 10(2), 1973)

    d rho = -P (dF beta + df) - (F^+)' dF' rho.

Where bounds hold some of beta, those columns count as known.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from ambient_trainer.data.trace import Array
from ambient_trainer.estimation.structure import Linearised, Unknowns

_RANK_TOLERANCE = 1e-11


@dataclass(frozen=True)
class Projected:
    """beta (p,), the residual rho (r,) in compressed rows, and its Jacobian in theta (r, P)."""

    beta: Array
    residual: Array
    jacobian: Array


def project(problem: Linearised, bounds: Unknowns) -> Projected:
    """Solve for the linear unknowns within their bounds and differentiate what is left."""
    target = problem.target - problem.fixed
    loose = np.ones(problem.free.shape[1], dtype=bool)
    U, inverse = _pseudo_inverse(problem.free)
    beta = inverse @ target
    if (beta < bounds.low).any() or (beta > bounds.high).any():
        beta, loose = _bounded(problem.free, target, bounds)
        U, inverse = _pseudo_inverse(problem.free[:, loose])
    residual = target - problem.free @ beta
    moved = problem.free_slope @ beta + problem.fixed_slope
    jacobian = -(moved - moved @ U @ U.T).T
    jacobian -= inverse.T @ (residual @ problem.free_slope[:, :, loose]).T
    return Projected(beta, residual, jacobian)


def _pseudo_inverse(F: Array) -> tuple[Array, Array]:
    """An orthonormal basis of the columns (r, k) and the pseudo-inverse (p, r)."""
    if not F.shape[1]:
        return np.zeros((F.shape[0], 0)), np.zeros((0, F.shape[0]))
    scale = np.linalg.norm(F, axis=0)
    scale[scale == 0] = 1.0
    U, singular, Vt = np.linalg.svd(F / scale, full_matrices=False)
    kept = singular > _RANK_TOLERANCE * singular[0]
    return U[:, kept], (Vt[kept].T / singular[kept]) @ U[:, kept].T / scale[:, None]


def _bounded(F: Array, target: Array, bounds: Unknowns) -> tuple[Array, NDArray[np.bool_]]:
    solution = lsq_linear(F, target, (bounds.low, bounds.high), method="bvls")
    held, loose = solution.active_mask, solution.active_mask == 0
    beta = np.where(held < 0, bounds.low, np.where(held > 0, bounds.high, solution.x))
    # what the bounds leave loose is solved exactly, so that the derivative above is that of the solution
    _, inverse = _pseudo_inverse(F[:, loose])
    beta[loose] = np.clip(inverse @ (target - F[:, ~loose] @ beta[~loose]), bounds.low[loose], bounds.high[loose])
    return beta, loose
