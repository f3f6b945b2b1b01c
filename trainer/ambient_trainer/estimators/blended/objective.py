"""The objective of a filter: a quadratic function of its weights at given poles, whose minimum is one linear solve.

    J(w) = sum_l k_l mean (target_l - S_l' w)^2 + noise w' N w + one_degree (sum of DC gains - 1)^2

over the training runs l, S_l being the filter's signals. Each term is a Gram matrix; the last entry of w is the offset.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from ambient_trainer.estimation.least_squares import Gram
from ambient_trainer.estimators.blended.filter_basis import dc_gains, noise_gram, signals
from ambient_trainer.estimators.blended.recipe import FilterRules
from ambient_trainer.estimators.blended.training_set import TrainingRun, TrainingSet

Array = NDArray[np.float64]

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
