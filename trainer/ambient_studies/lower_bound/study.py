"""Linear lower bound of a scenario: what the best linear causal filter, fitted to the scenario itself, leaves of it.

Three filters, in the order of what they may use: of the model's order over its inputs; a bank of low-passes of the same
inputs; a bank over every zone of the simulated phone. They are fitted to some seeds of a scenario and scored, as the
model is, on others: weather and noise are new, the programme is not.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from ambient_model.faults import refuse
from ambient_model.model import Model
from ambient_model.trace import REFERENCE
from ambient_studies import Progress
from ambient_studies.lower_bound.bank import fitted, gram, rmse_degC
from ambient_trainer.data import Trace
from ambient_trainer.estimators import Effort, estimator
from ambient_trainer.evaluation import evaluate_trace
from ambient_trainer.simulator import load_device, load_scenario, simulate_many

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
    """Linear lower bound of each scenario, beside the model's error.

    Parameters
    ----------
    model : Model
        Reads the simulated phone's sensors.
    scenarios : sequence of str
        Names of shipped scenarios.
    seeds : Seeds
        Of the runs to fit and to score.
    period_s : float
        Sampling period.
    progress : callable
        Called with what is under way, how much of it is done, and of how much.

    Returns
    -------
    list of Bound
        One a scenario.

    Raises
    ------
    Refused
        Where the simulated phone lacks one of the model's inputs, before anything is simulated.
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
