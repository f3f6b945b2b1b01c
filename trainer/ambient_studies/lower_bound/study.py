"""Linear lower bound of a scenario: what the best linear causal filter, fitted to the scenario itself, leaves of it.

Three filters, in the order of what they may use: of the model's order over its inputs; a bank of low-passes of the same
inputs; a bank over every zone of the simulated phone. They are fitted to some seeds of a scenario and scored, as the
model is, on others: weather and noise are new, the programme is not.

A bank is the richest linear filter that needs no search: least squares over every input and many low-passes of each,

    y[k] = offset + sum_i (w_i0 u_i[k] + sum_j w_ij l_ij[k])
    l_ij = (1 - a_j)/(z - a_j) u_i,    a_j = exp(-T / tau_j).

With time constants evenly spaced in logarithm it approaches any causal filter of decaying memory. The ridge penalty,
against fitting the noise, is selected by leaving out one training run at a time.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np

from ambient_model.faults import refuse
from ambient_model.model import Model
from ambient_model.trace import REFERENCE
from ambient_studies import Progress
from ambient_trainer.data import Array, Trace, sampling_period_s
from ambient_trainer.estimators import Effort, estimator
from ambient_trainer.evaluation import evaluate_trace
from ambient_trainer.lti import low_pass
from ambient_trainer.simulator import load_device, load_scenario, simulate_many

_FASTEST_S, _SLOWEST_S = 2.0, 8000.0
_RIDGES = tuple(10.0**exponent for exponent in range(-10, -1))
_LAGS_OF_ITS_OWN, _LAGS_OF_ALL = 14, 5
_MOST_STATES = 4
_STARTS = 4
_DRIVES = ("soc_power_W", "charging_on", "cpu_load_frac", "battery_current_A")
"""What the simulated phone logs beside its zones."""


@dataclass(frozen=True)
class Filter:
    """A filter that was fitted to the scenario it is scored on: sensors, fitted numbers, error."""

    name: str
    sensors: int
    weights: int
    rmse_degC: float


@dataclass(frozen=True)
class Bound:
    """A scenario: the model's error, and those of the filters."""

    scenario: str
    samples: int
    model_rmse_degC: float
    filters: tuple[Filter, ...]

    def ratio(self, filter: Filter) -> float:
        """The model's error over the filter's."""
        return self.model_rmse_degC / filter.rmse_degC


@dataclass(frozen=True)
class Seeds:
    """Of the runs that the filters are fitted to, and of those that all are scored on."""

    fitted: tuple[int, ...]
    scored: tuple[int, ...]


def lower_bounds(
    model: Model, scenarios: Sequence[str], seeds: Seeds, period_s: float, progress: Progress
) -> list[Bound]:
    """Linear lower bound of each scenario, beside the error of a model that reads the simulated phone's sensors.

    Raises :class:`Refused` where the phone lacks one of the model's inputs, before anything is simulated.
    """
    _require_inputs(model)
    for name in scenarios:
        load_scenario(name)
    found = []
    for name in scenarios:
        runs = [(name, seed, ()) for seed in (*seeds.fitted, *seeds.scored)]
        show = partial(progress, f"scenario {name}: simulating")
        traces = [each.trace for each in simulate_many(runs, period_s, progress=show, zones=load_device().zones)]
        found.append(_bound(model, name, traces[: len(seeds.fitted)], traces[len(seeds.fitted) :], progress))
    return found


def _bound(model: Model, name: str, training: Sequence[Trace], scored: Sequence[Trace], progress: Progress) -> Bound:
    own = [each.column for each in model.main.inputs]
    zones = [column for column in training[0].columns if column.endswith("_degC") and column != REFERENCE]
    fits = {
        "its own order": lambda: _of_order(len(model.main.states), own, training, scored),
        "bank": lambda: _bank("bank of low-passes", own, _LAGS_OF_ITS_OWN, training, scored),
        "every zone": lambda: _bank("bank over every zone", zones, _LAGS_OF_ALL, training, scored),
    }
    progress(f"scenario {name}: model", 0, len(fits) + 1)
    evaluations = [evaluate_trace(model, trace) for trace in scored]
    filters = []
    for done, (step, fit) in enumerate(fits.items(), start=1):
        progress(f"scenario {name}: {step}", done, len(fits) + 1)
        filters.append(fit())
    rmse = math.sqrt(float(np.mean([each.metrics.rmse_degC**2 for each in evaluations])))
    return Bound(name, sum(each.scored for each in evaluations), rmse, tuple(filters))


def _require_inputs(model: Model) -> None:
    logged = {*_DRIVES, *(f"{zone.name}_degC" for zone in load_device().zones)}
    missing = [each.column for each in model.main.inputs if each.column not in logged]
    if missing:
        raise refuse(
            f"model '{model.name}'",
            "inputs",
            f"reads {', '.join(missing)}, which the simulated phone does not log",
            "fit one to `ambient-trainer simulate 5`",
        )


def _of_order(states: int, columns: Sequence[str], training: Sequence[Trace], scored: Sequence[Trace]) -> Filter:
    order = min(max(states, 1), _MOST_STATES)
    fit = estimator(f"free-{order}").fit(training, Effort(starts=_STARTS), inputs=columns)
    squares = [np.nanmean((trace.reference - fit.estimate_degC(trace)) ** 2) for trace in scored]
    weights = order + len(columns) * (1 + order) + 1
    return Filter(f"free filter of order {order}", len(columns), weights, math.sqrt(float(np.mean(squares))))


def _bank(name: str, columns: Sequence[str], lags: int, training: Sequence[Trace], scored: Sequence[Trace]) -> Filter:
    weights = fitted([gram(trace, columns, lags) for trace in training])
    rmse = rmse_degC(weights, [gram(trace, columns, lags) for trace in scored])
    return Filter(name, len(columns), len(weights), rmse)


class Gram(NamedTuple):
    """The mean square of target - table' w as a function of the weights: w' quadratic w - 2 linear' w + constant."""

    quadratic: Array
    linear: Array
    constant: float


def gram(trace: Trace, columns: Sequence[str], lags: int) -> Gram:
    """The Gram of a run without gaps over ``columns``, ``lags`` low-passes each, and the offset."""
    u = np.vstack([trace.column(name) for name in columns])
    period_s = sampling_period_s(trace.time_s)
    before = np.concatenate([u[:, :1], u[:, :-1]], axis=1).T
    lags_s = np.geomspace(_FASTEST_S, _SLOWEST_S, lags).tolist()
    lows = [low_pass(before, lag_s, period_s, u[:, 0]).T for lag_s in lags_s]
    S, target = np.concatenate([u, *lows, np.ones((1, u.shape[1]))]), trace.reference
    return Gram(S @ S.T / len(target), S @ target / len(target), float(target @ target) / len(target))


def fitted(runs: Sequence[Gram]) -> Array:
    """Ridge-regression weights (p,), with the penalty under which each run is predicted best from the others."""
    if len(runs) == 1:
        return _solved(runs, _RIDGES[len(_RIDGES) // 2])

    def left_out(ridge: float) -> float:
        others = [[*runs[:index], *runs[index + 1 :]] for index in range(len(runs))]
        return sum(_mean_square(_solved(rest, ridge), run) for rest, run in zip(others, runs))

    return _solved(runs, min(_RIDGES, key=left_out))


def rmse_degC(weights: Array, runs: Sequence[Gram]) -> float:
    """The RMSE over all ``runs``, each with the same weight."""
    return math.sqrt(sum(_mean_square(weights, run) for run in runs) / len(runs))


def _mean_square(weights: Array, run: Gram) -> float:
    """In degC^2; what rounding makes negative is zero."""
    return max(float(weights @ run.quadratic @ weights - 2 * weights @ run.linear + run.constant), 0.0)


def _solved(runs: Sequence[Gram], ridge: float) -> Array:
    """The weights of least mean square over ``runs``; the ridge is added to a unit diagonal (Marquardt 1963)."""
    quadratic, linear = np.sum([run.quadratic for run in runs], axis=0), np.sum([run.linear for run in runs], axis=0)
    size = np.sqrt(np.maximum(np.diag(quadratic), 1e-30))
    return np.asarray(
        np.linalg.solve(quadratic / np.outer(size, size) + ridge * np.eye(len(size)), linear / size) / size
    )
