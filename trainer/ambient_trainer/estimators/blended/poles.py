"""Searches a filter's poles; its weights at given poles are one linear solve.

The filter has four states and is a weighted sum of signals. Per input: the input itself and, for each of two sections
of second order, the input behind it and the difference of that to its last value, scaled to like size. Everything that
is quadratic in the weights is then one Gram matrix:

    J(w) = sum_l k_l mean (target_l - S_l' w)^2 + noise w' N w + one_degree (sum of DC gains - 1)^2

over the training runs l, S_l being the filter's signals; the last entry of w is the offset. Two poles are real and
slow, bounded below the age of the log, and a damped pair inverts the lags. The unknowns are logarithms: the slower
rate, the ratio of the two, and omega and zeta of the pair. Bounds on them are the recipe's rules.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_discrete_lyapunov
from scipy.optimize import minimize
from scipy.signal import lfilter

from ambient_trainer.estimation.least_squares import Gram
from ambient_trainer.estimators.blended.recipe import FilterRules
from ambient_trainer.estimators.blended.training_set import TrainingRun, TrainingSet

Array = NDArray[np.float64]

SIGNALS = 5
"""Per input."""


def denominators(poles: Array, period_s: float) -> list[Array]:
    """Per section the discrete denominator [1, a1, a2]; ``poles`` are (log omega, log zeta) of each, omega in 1/s."""
    found = []
    for omega, zeta in np.exp(poles).reshape(-1, 2):
        root = np.sqrt(complex(zeta * zeta - 1))
        slow, fast = np.exp(omega * period_s * (-zeta + root)), np.exp(omega * period_s * (-zeta - root))
        found.append(np.array([1.0, -(slow + fast).real, (slow * fast).real]))
    return found


def signals(poles: Array, period_s: float, inputs: Array, every: int = 1) -> Array:
    """Each ``every``-th sample of all signals, (5 m, ...), of ``inputs`` (m, N), signal by signal.

    From equilibrium with the first sample.
    """
    rows = [inputs[:, ::every]]
    start = inputs[:, :1]
    # two samples of equilibrium ahead: the filtered signal is read one and two samples late
    moved = np.concatenate([np.zeros((len(inputs), 2)), inputs - start], axis=1)
    for a in denominators(poles, period_s):
        filtered = lfilter([a.sum()], a, moved, axis=1)
        last, before = filtered[:, 1:-1:every], filtered[:, :-2:every]
        rows += [last + start, (last - before) / math.sqrt(a.sum())]
    return np.concatenate(rows)


def dc_gains(inputs: int) -> Array:
    """Per input (row) and weight (column) what the weight adds to the input's DC gain."""
    return np.asarray(np.kron([1.0, 1.0, 0.0, 1.0, 0.0], np.eye(inputs)), dtype=np.float64)


def noise_gram(poles: Array, period_s: float, inputs: int) -> Array:
    """N with w' N w = the output's variance per variance of white noise in every input.

    With x[k+1] = A x[k] + B v[k] and the signals C x + D v of one input, their covariance is C P C' + D D', where
    P = A P A' + B B'.
    """
    A, B, C, D = np.zeros((4, 4)), np.zeros((4, 1)), np.zeros((SIGNALS, 4)), np.zeros((SIGNALS, 1))
    D[0] = 1.0
    for section, a in enumerate(denominators(poles, period_s)):
        at, row = 2 * section, 1 + 2 * section
        A[at : at + 2, at : at + 2] = [[-a[1], -a[2]], [1.0, 0.0]]
        B[at] = a.sum()
        C[row, at] = 1.0
        C[row + 1, at : at + 2] = np.array([1.0, -1.0]) / math.sqrt(a.sum())
    P = solve_discrete_lyapunov(A, B @ B.T)
    return np.kron(C @ P @ C.T + D @ D.T, np.eye(inputs))


def numerators(poles: Array, period_s: float, weights: Array) -> tuple[Array, list[Array]]:
    """The direct gains (m,) and per section the numerators (2, m) of z^-1 and z^-2 over its denominator.

    ``weights`` (5 m,) are those of :func:`signals`.
    """
    direct, *rest = weights.reshape(SIGNALS, -1)
    found = []
    for a, level, change in zip(denominators(poles, period_s), rest[::2], rest[1::2]):
        total = a.sum()
        found.append(np.vstack([level * total + change * math.sqrt(total), -change * math.sqrt(total)]))
    return direct, found


_RIDGE = 1e-10
"""Of each weight's own scale: keeps the solve defined where two signals are the same."""


class Objective:
    """J of the runs that ``counts`` weighs, all of the same inputs and period."""

    def __init__(self, runs: TrainingSet, counts: Mapping[str, float], rules: FilterRules, period_s: float) -> None:
        self._runs = [(each, count / len(runs[name])) for name, count in counts.items() if count for each in runs[name]]
        self._rules = rules
        self.period_s = period_s
        self.inputs = len(self._runs[0][0].sensors_degC)

    def at(self, poles: Array) -> Gram:
        """J at ``poles``, as a function of the weights and the offset."""
        noise = noise_gram(poles, self.period_s, self.inputs)
        at_rest = np.append(dc_gains(self.inputs).sum(axis=0), 0.0)
        quadratic = self._rules.one_degree * np.outer(at_rest, at_rest)
        quadratic[:-1, :-1] += self._rules.noise * noise
        physics = Gram(quadratic, self._rules.one_degree * at_rest, self._rules.one_degree)
        runs = ((count, run_gram(poles, self.period_s, run)) for run, count in self._runs)
        return Gram.total([(1.0, physics), *runs])


def run_gram(poles: Array, period_s: float, run: TrainingRun) -> Gram:
    """The mean square of the filter's error in ``run``."""
    shown = signals(poles, period_s, run.sensors_degC, run.stride)
    table = np.vstack([shown, np.full((1, shown.shape[1]), float(run.absolute))])
    return Gram.of(table, run.target_degC[:: run.stride])


def best_weights(gram: Gram) -> Array:
    """Where ``gram`` is least."""
    return gram.minimum(_RIDGE)


_MOST_ITERATIONS = 40
_MOST_RATIO = 20.0
_MOST_DAMPING = 20.0
_STEP = 1e-3
_FLAT = 1e-7
"""Below this curvature of log J per e-fold squared, a pole makes no difference."""


class Searched(NamedTuple):
    """The best poles, (log omega, log zeta) of either section, and how the search ended."""

    poles: Array
    weights: Array
    """With the offset last."""
    objective: float
    evaluations: int
    converged: bool
    at_bound: tuple[bool, ...]
    """Per unknown of the search: slower rate, ratio, omega, zeta."""
    identifiable: bool
    """Whether the objective changes with every unknown that no bound holds."""


def section_poles(unknowns: Array) -> Array:
    """(log omega, log zeta) of either section at the search's unknowns."""
    log_rate, log_ratio, log_omega, log_zeta = unknowns
    # two rates r and r q: omega^2 = r^2 q, zeta = (1 + q) / (2 sqrt q) = cosh(log q / 2)
    return np.array([log_rate + log_ratio / 2, math.log(math.cosh(log_ratio / 2)), log_omega, log_zeta])


def first_unknowns(rules: FilterRules) -> Array:
    """Where the recipe starts the search."""
    slow, fast = max(rules.slow.time_constants_s), min(rules.slow.time_constants_s)
    return np.log([1 / slow, slow / fast, 1 / rules.fast.time_s, rules.fast.damping])


def search_poles(
    objective: Objective, rules: FilterRules, start: Array, show: Callable[[int, float], None]
) -> tuple[Searched, Array]:
    """The best poles near ``start`` with their weights, and their unknowns; ``show`` gets evaluations and J."""
    evaluations = 0

    def log_objective(unknowns: Array) -> float:
        nonlocal evaluations
        evaluations += 1
        gram = objective.at(section_poles(unknowns))
        found = gram(best_weights(gram))
        show(evaluations, found)
        return math.log(found)

    low, high = _bounds(rules, objective.period_s)
    result = minimize(
        log_objective,
        np.clip(start, low, high),
        method="L-BFGS-B",
        bounds=list(zip(low, high)),
        options={"maxiter": _MOST_ITERATIONS, "ftol": 1e-7, "eps": 1e-5},
    )
    at_bound = (result.x < low + 2 * _STEP) | (result.x > high - 2 * _STEP)
    poles = section_poles(result.x)
    gram = objective.at(poles)
    weights = best_weights(gram)
    found = Searched(
        poles,
        weights,
        gram(weights),
        evaluations,
        bool(result.success),
        tuple(at_bound.tolist()),
        _curved(log_objective, result.x, np.flatnonzero(~at_bound)),
    )
    return found, result.x


def _bounds(rules: FilterRules, period_s: float) -> tuple[Array, Array]:
    fastest = 1 / (2 * period_s)
    low = np.log([1 / rules.slow.slowest_s, rules.slow.least_ratio, 1 / rules.slow.slowest_s, rules.fast.least_damping])
    high = np.log([fastest, _MOST_RATIO, fastest, _MOST_DAMPING])
    return low, high


def _curved(function: Callable[[Array], float], at: Array, free: NDArray[np.intp]) -> bool:
    """Whether ``function`` rises in every direction of the ``free`` unknowns."""
    centre = function(at)
    hessian = np.empty((len(free), len(free)))
    steps = np.eye(len(at))[free] * _STEP
    alone = [function(at + step) for step in steps]
    for i, a in enumerate(steps):
        for j, b in enumerate(steps[: i + 1]):
            there = function(at + a + b)
            hessian[i, j] = hessian[j, i] = (there - alone[i] - alone[j] + centre) / _STEP**2
    return bool(len(free) == 0 or np.linalg.eigvalsh(hessian)[0] > _FLAT)
