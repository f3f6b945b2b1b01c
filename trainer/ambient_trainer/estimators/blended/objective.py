"""The objective of a filter: a quadratic function of its weights at given poles, whose minimum is one linear solve.

    J(w) = sum_l k_l mean (target_l - S_l' w)^2 + noise w' N w + one_degree (sum of DC gains - 1)^2

over the training runs l, S_l being the filter's signals. Each term is a Gram matrix; the last entry of w is the offset.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambient_trainer.estimators.blended.filter_basis import dc_gains, noise_gram, signals
from ambient_trainer.estimators.blended.recipe import FilterRules
from ambient_trainer.estimators.blended.training_set import TrainingRun, TrainingSet

Array = NDArray[np.float64]

_RIDGE = 1e-10
"""Of each weight's own scale: keeps the solve defined where two signals are the same."""


class Gram(NamedTuple):
    """w' quadratic w - 2 linear' w + constant."""

    quadratic: Array
    linear: Array
    constant: float

    def __call__(self, weights: Array) -> float:
        """The value at ``weights``."""
        return float(weights @ self.quadratic @ weights - 2 * weights @ self.linear + self.constant)

    def plus(self, other: Gram, factor: float) -> Gram:
        """The sum with ``factor`` times the other."""
        return Gram(
            self.quadratic + factor * other.quadratic,
            self.linear + factor * other.linear,
            self.constant + factor * other.constant,
        )


class Objective:
    """J of the runs that ``counts`` weighs, all of the same inputs and period."""

    def __init__(self, runs: TrainingSet, counts: Mapping[str, float], rules: FilterRules, period_s: float) -> None:
        self._lessons = [
            (each, count / len(runs[name])) for name, count in counts.items() if count for each in runs[name]
        ]
        self._rules = rules
        self.period_s = period_s
        self.inputs = len(self._lessons[0][0].sensors_degC)

    def at(self, poles: Array) -> Gram:
        """J at ``poles``, as a function of the weights and the offset."""
        noise = noise_gram(poles, self.period_s, self.inputs)
        at_rest = np.append(dc_gains(self.inputs).sum(axis=0), 0.0)
        quadratic = self._rules.one_degree * np.outer(at_rest, at_rest)
        quadratic[:-1, :-1] += self._rules.noise * noise
        total = Gram(quadratic, self._rules.one_degree * at_rest, self._rules.one_degree)
        for run, count in self._lessons:
            total = total.plus(run_gram(poles, self.period_s, run), count)
        return total


def run_gram(poles: Array, period_s: float, run: TrainingRun) -> Gram:
    """The mean square of the filter's error in ``run``."""
    shown = signals(poles, period_s, run.sensors_degC, run.stride)
    table = np.vstack([shown, np.full((1, shown.shape[1]), float(run.absolute))])
    target = run.target_degC[:: run.stride]
    count = len(target)
    return Gram(table @ table.T / count, table @ target / count, float(target @ target) / count)


def best_weights(gram: Gram) -> Array:
    """Where ``gram`` is least."""
    scale = np.sqrt(np.diag(gram.quadratic)) + 1e-15
    scaled = gram.quadratic / scale[:, None] / scale + _RIDGE * np.eye(len(scale))
    return np.asarray(np.linalg.solve(scaled, gram.linear / scale) / scale)
