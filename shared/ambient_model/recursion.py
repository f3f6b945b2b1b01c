"""One step of the recursion is defined here and nowhere else.

Products are added one by one, from left to right, and not by ``sum``, which since Python 3.12 rounds otherwise: every
interpreter computes the same bits.
"""

import math
from collections.abc import Sequence
from operator import mul

from ambient_model.model import Discrete, Matrix

Vector = Sequence[float]

_DOUBLINGS = 40
"""2^40 steps are longer than anything that is ever simulated."""


def dot(factors: Vector, values: Vector) -> float:
    """The scalar product."""
    total = 0.0
    for factor, value in zip(factors, values):
        total += factor * value
    return total


def equilibrium(initial: Matrix, u: Vector) -> list[float]:
    """The state in thermal equilibrium with the inputs ``u``: x0 = X0 u."""
    return [dot(row, u) for row in initial]


def output(discrete: Discrete, offset: float, x: Vector, u: Vector) -> float:
    """The ambient in degC: y = C x + D u + offset."""
    total = 0.0
    for factor, value in zip(discrete.C[0], x):
        total += factor * value
    for factor, value in zip(discrete.D[0], u):
        total += factor * value
    return total + offset


def advance(discrete: Discrete, x: Vector, u: Vector) -> list[float]:
    """The state one period later: A x + B u."""
    after = []
    for a, b in zip(discrete.A, discrete.B):
        total = 0.0
        for factor, value in zip(a, x):
            total += factor * value
        for factor, value in zip(b, u):
            total += factor * value
        after.append(total)
    return after


def spectral_norms(A: Matrix, doublings: int) -> list[float]:
    """The maximum row sums of abs(A^(2^k)) for k = 0 .. ``doublings``; stops early at one beyond 1e100 or at 0."""
    power = [list(row) for row in A]
    norms: list[float] = []
    for _ in range(doublings + 1):
        norms.append(_norm(power) if power else 0.0)
        if norms[-1] > 1e100 or norms[-1] == 0.0:
            break
        power = _product(power, power)
    return norms


def is_stable(A: Matrix) -> bool:
    """Whether the spectral radius of A is below 1, by more than 1e-12.

    A power of A with a norm below 1 proves it; below 0.5 leaves room for rounding, which after 2^40 steps moves the
    norm of a circuit that loses nothing (exactly 1) by some 1e-4.
    """
    return min(spectral_norms(A, _DOUBLINGS)) < 0.5


def is_positive_definite(matrix: Matrix) -> bool:
    """Whether a matrix is symmetric and has a Cholesky factor with positive diagonal."""
    size = len(matrix)
    factor: list[list[float]] = []
    for i, row in enumerate(matrix):
        current: list[float] = []
        for j in range(i):
            if abs(row[j] - matrix[j][i]) > 1e-9 * (abs(row[j]) + abs(matrix[j][i])):
                return False
            current.append((row[j] - sum(map(mul, current, factor[j]))) / factor[j][j])
        square = row[i] - sum(map(mul, current, current))
        if not square > 1e-12 * abs(row[i]):
            return False
        factor.append([*current, math.sqrt(square)])
    return len(factor) == size


def settling_steps(A: Matrix, remainder: float) -> int:
    """The number of steps after which a wrong initial state has decayed to ``remainder`` of itself, in norm."""
    if not A:
        return 0
    powers = [[list(row) for row in A]]
    while _norm(powers[-1]) > remainder:
        if len(powers) > _DOUBLINGS:
            return 1 << _DOUBLINGS
        powers.append(_product(powers[-1], powers[-1]))
    # the longest run of steps that does not suffice, from its largest power of two down
    steps, reached = 0, [[float(i == j) for j in range(len(A))] for i in range(len(A))]
    for exponent in reversed(range(len(powers) - 1)):
        longer = _product(reached, powers[exponent])
        if _norm(longer) > remainder:
            steps, reached = steps + (1 << exponent), longer
    return steps + 1


def _norm(matrix: list[list[float]]) -> float:
    """The maximum row sum of absolute values."""
    return max(sum(map(abs, row)) for row in matrix)


def _product(left: list[list[float]], right: list[list[float]]) -> list[list[float]]:
    columns = list(zip(*right))
    return [[sum(map(mul, row, column)) for column in columns] for row in left]
