"""The limit: what the best linear causal filter leaves on a scenario that it was fitted to, beside what a model leaves.

Three such filters, in the order of what they may do: of the model's own order over the model's own inputs; a bank of
low-passes of the same inputs; and a bank over every zone that the simulated phone has. They are fitted to some seeds of
a scenario and scored, as the model is, on others: the weather and the noise are new, the programme is not.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from ambient_model.faults import refuse
from ambient_model.model import Model
from ambient_model.trace import REFERENCE
from ambient_studies.lower_bound.bank import gram, rmse_degC, taught
from ambient_trainer.data.trace import Trace
from ambient_trainer.estimators.estimate import estimate_degC
from ambient_trainer.estimators.fit import Effort, fit_free_filter
from ambient_trainer.evaluation.evaluate import evaluate_trace
from ambient_trainer.simulator.device_file import load_device
from ambient_trainer.simulator.scenario import load_scenario
from ambient_trainer.simulator.simulate import simulate_many

Progress = Callable[[str, int, int], None]
"""What is under way, how much of it is done, of how much."""

_LAGS_OF_ITS_OWN, _LAGS_OF_ALL = 14, 5
_MOST_STATES = 4
_STARTS = 4
_DRIVES = ("soc_power_W", "charging_on", "cpu_load_frac", "battery_current_A")
"""What the simulated phone logs beside its zones."""


@dataclass(frozen=True)
class Filter:
    """A filter that was fitted to the scenario it is scored on."""

    name: str
    reads: int
    """How many sensors."""
    weights: int
    """How many numbers were fitted."""
    rmse_degC: float


@dataclass(frozen=True)
class Limit:
    """A scenario: what the model leaves of it, and what the filters do."""

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

    @staticmethod
    def after(scored: Sequence[int], fitted: int) -> Seeds:
        """``fitted`` seeds from the one after the last of the ``scored`` on."""
        first = max(scored) + 1
        return Seeds(tuple(range(first, first + fitted)), tuple(scored))


def limits(model: Model, scenarios: Sequence[str], seeds: Seeds, period_s: float, progress: Progress) -> list[Limit]:
    """The limit of each scenario; raises :class:`Refused` where the simulated phone lacks one of the model's inputs."""
    _require_inputs(model)
    for name in scenarios:
        load_scenario(name)
    found = []
    for name in scenarios:
        runs = [(name, seed, ()) for seed in (*seeds.fitted, *seeds.scored)]
        told = partial(progress, f"scenario {name}: simulating")
        simulated = simulate_many(runs, period_s, progress=told, zones=load_device().zones)
        traces = [each.trace for each in simulated]
        found.append(_limit(model, name, traces[: len(seeds.fitted)], traces[len(seeds.fitted) :], progress))
    return found


def _limit(model: Model, name: str, fitted: Sequence[Trace], scored: Sequence[Trace], progress: Progress) -> Limit:
    own = [each.column for each in model.main.inputs]
    zones = [column for column in fitted[0].columns if column.endswith("_degC") and column != REFERENCE]
    steps = ("model", "its own order", "bank", "every zone")

    def told(index: int) -> None:
        progress(f"scenario {name}: {steps[index]}", index, len(steps))

    told(0)
    evaluations = [evaluate_trace(model, trace) for trace in scored]
    mean_squares = [each.metrics.rmse_degC**2 for each in evaluations]
    told(1)
    filters = [_of_order(len(model.main.states), own, fitted, scored)]
    told(2)
    filters.append(_bank("bank of low-passes", own, _LAGS_OF_ITS_OWN, fitted, scored))
    told(3)
    filters.append(_bank("bank over every zone", zones, _LAGS_OF_ALL, fitted, scored))
    samples = sum(each.scored for each in evaluations)
    return Limit(name, samples, math.sqrt(float(np.mean(mean_squares))), tuple(filters))


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


def _of_order(states: int, columns: Sequence[str], fitted: Sequence[Trace], scored: Sequence[Trace]) -> Filter:
    order = min(max(states, 1), _MOST_STATES)
    fit = fit_free_filter(order, fitted, Effort(starts=_STARTS), inputs=columns)
    errors = [trace.reference - estimate_degC(fit.system, fit.hold, fit.inputs, trace) for trace in scored]
    rmse = math.sqrt(float(np.mean([np.nanmean(each**2) for each in errors])))
    weights = order + len(columns) * (1 + order) + 1
    return Filter(f"free filter of order {order}", len(columns), weights, rmse)


def _bank(name: str, columns: Sequence[str], lags: int, fitted: Sequence[Trace], scored: Sequence[Trace]) -> Filter:
    weights = taught([gram(trace, columns, lags) for trace in fitted])
    rmse = rmse_degC(weights, [gram(trace, columns, lags) for trace in scored])
    return Filter(name, len(columns), len(weights), rmse)
