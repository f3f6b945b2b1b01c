"""Recipes: a YAML file beside this module, or a user's, describes filters that are fitted beside a forward circuit.

The circuit is fitted to the log and simulates what the log lacks. Each filter minimises, over its poles and weights,

    sum_l k_l mean (target_l - estimate_l)^2 + noise N^2 + offset^2 sum g_i^2 + one_degree (sum g_i - 1)^2,

l being the training runs, N the noise gain and g_i the DC gain of sensor i. Two poles are real and slow, bounded below
the age of the log, and a damped pair inverts the lags. All searches but the first start where the main filter's ended.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from ambient_model.faults import refuse
from ambient_model.model import Term
from ambient_model.trace import REFERENCE
from ambient_trainer.circuits.circuit import Circuit
from ambient_trainer.data import Array, Segment, Trace, resolution_of, segments
from ambient_trainer.estimation import FreeFilter, Progress, Unknowns, WeightedRun, search, weighted_filter
from ambient_trainer.estimation.error_variance import Moment, fit_error_variance, half_widths
from ambient_trainer.estimation.uncertainty import autocorrelation_time
from ambient_trainer.estimators.base import (
    Effort,
    Estimator,
    Fit,
    SecondaryFit,
    Training,
    require_informative,
    slowest_period_s,
    source_of,
)
from ambient_trainer.estimators.blended.forward import Forward, ForwardFit, PlantRecord
from ambient_trainer.estimators.blended.recipe import LOGGED, RESIDUAL, FilterRules, Recipe, find_recipe, recipe_names
from ambient_trainer.estimators.blended.training_set import TrainingSet, TrainingSetDesign, fit_ambient, fit_workload
from ambient_trainer.estimators.estimate import Blended, blended
from ambient_trainer.estimators.searched import closing_notes, fallbacks_of, filter_fit
from ambient_trainer.lti.response import noise_gain

NAMES = recipe_names()
_CIRCUIT_PERIOD_S = 5.0
"""Nothing that the circuit holds is faster, and a coarser grid makes its fit faster."""
_FEWEST_SAMPLES = 1000


def find(name: str) -> RecipeEstimator | None:
    """The estimator of the shipped recipe of that name, or of the recipe in that YAML file, or None."""
    found = find_recipe(name)
    return None if found is None else RecipeEstimator(*found)


class RecipeEstimator(Estimator):
    """Fits what a recipe describes; it names the trace columns that it reads."""

    reads_any = False

    def __init__(self, recipe: Recipe, circuit: Circuit) -> None:
        self.recipe, self.circuit, self.name = recipe, circuit, recipe.name
        self.own_columns = recipe.sensor_columns

    def searches(self, effort: Effort) -> int:
        """The circuit's, the main filter's, the secondary one's and one a fallback."""
        return 3 + len(self.recipe.sensors)

    def training(
        self, traces: Sequence[Trace], inputs: Sequence[str] | None, period_s: float | None, pieces: int
    ) -> Training:
        """The log without gaps, each piece to be started cold."""
        recipe, period = self.recipe, period_s or slowest_period_s(traces)
        require_informative(traces, recipe.sensor_columns, (REFERENCE,))
        columns = (*recipe.sensor_columns, REFERENCE, *recipe.drive_columns)
        stretches = [each for trace in traces for each in segments(trace, columns, (), period)]
        log = [piece for each in stretches for piece in each.pieces(pieces)]
        samples = sum(each.inputs.shape[1] for each in log)
        if samples < _FEWEST_SAMPLES:
            problem = f"{samples} samples are too few for {recipe.name}, which needs {_FEWEST_SAMPLES}"
            hint = "log hours, at 1 s, with work, pauses and an ambient that changes"
            raise refuse(source_of(traces), "", problem, hint)
        return Training(columns, log, traces)

    def fit_to(self, training: Training, effort: Effort, progress: Progress | None) -> Fit:
        """The fit to this training data.

        Each search has one start, the recipe's: ``effort.starts`` is not used. Cancelled, it leaves out the
        fallbacks that are not done; before the first it raises :class:`Cancelled`.
        """
        recipe, traces, period = self.recipe, training.traces, training.segments[0].period_s
        records = [record_of(recipe, dict(zip(training.columns, each.inputs))) for each in training.segments]
        stride = max(1, round(_CIRCUIT_PERIOD_S / period))
        coarse, coarse_period_s = [each.every(stride) for each in records], stride * period
        samples = sum(len(each.ambient_degC) for each in records)

        def show(number: int, evaluation: int, square: float) -> None:
            if progress is not None:
                progress(number, evaluation, square * samples)
            if number == 0:  # a circuit that is not fitted to the end is of no use
                effort.budget.check()

        # a log that lacks something is refused before anything is searched
        ambient = fit_ambient([each.ambient_degC for each in coarse], coarse_period_s, source_of(traces))
        workload = fit_workload(coarse, recipe.work, source_of(traces))
        fitted = Forward(recipe, self.circuit).fit(coarse, coarse_period_s, partial(show, 0))
        columns = ([trace.column(name) for trace in traces] for name in recipe.sensor_columns)
        steps = tuple(resolution_of(np.concatenate(each)) for each in columns)
        design = TrainingSetDesign(recipe, fitted.plant, ambient, workload, period, stride, effort.seed, steps)
        runs = design.runs(records)
        log = Training(recipe.sensor_columns, runs[LOGGED], traces)
        fit = fit_filters(recipe, runs, log, effort, lambda n, *rest: show(1 + n, *rest))
        # errors are smaller in the very runs that the filters were fitted to
        moments = unseen(recipe, fit, replace(design, draw=1).runs(records))
        lags = recipe.error_variance
        sides = (Term(of, lags.secondary_lag_s, 1.0) for of in ("guard_above", "guard_below"))
        variance = fit_error_variance(moments, period, (Term("movement", lags.movement_lag_s, 1.0), *sides))
        return _assembled(recipe, replace(fit, error_variance=variance), fitted, log.segments)


def record_of(recipe: Recipe, rows: Mapping[str, Array]) -> PlantRecord:
    """What the recipe makes of trace columns (N,)."""
    measured, shared = (
        np.sum([watts * rows[column] for column, watts in each.items()], axis=0)
        for each in (recipe.heat.measured.watts, recipe.heat.shared.watts)
    )
    sensors = np.vstack([rows[column] for column in recipe.sensor_columns])
    return PlantRecord(sensors, rows[REFERENCE], measured, shared, rows[recipe.work.signal])


def _assembled(recipe: Recipe, fit: Fit, circuit: ForwardFit, logged: Sequence[Segment]) -> Fit:
    """The fit with errors and remarks of the blended estimate, its filters and its circuit together."""
    assert fit.secondary
    assert fit.error_variance
    estimates = [published(fit, each) for each in logged]
    errors = np.concatenate([each.outputs[0] - blend.ambient_degC for each, blend in zip(logged, estimates)])
    rmse_degC = float(np.sqrt(np.mean(errors**2)))
    secondary, threshold_degC = fit.secondary
    members = [fit, secondary, *fit.fallbacks.values()]
    moments = [Moment(each.ambient_degC, each.ambient_degC, each.apart_degC) for each in estimates]
    half = half_widths(fit.error_variance, moments, fit.periods_s[0])
    main, other = _filter(fit), _filter(secondary)
    misfit = ", ".join(f"{name} {each:.2f}" for name, each in circuit.misfit_degC.items())
    return replace(
        fit,
        errors_degC=(errors,),
        rmse_degC=rmse_degC,
        start_rmses_degC=(rmse_degC,),
        residual_memory_samples=autocorrelation_time(errors),
        converged=circuit.converged and all(each.converged for each in members) and not fit.stopped,
        evaluations=circuit.evaluations + sum(each.evaluations for each in members),
        details={
            "main": main,
            "guard": other,
            "threshold_degC": threshold_degC,
            "half_width_90_degC": half,
            "fallbacks": {name: {**_filter(each), "rmse_degC": each.rmse_degC} for name, each in fit.fallbacks.items()},
            "forward_circuit": {
                "name": recipe.circuit,
                "values": circuit.values,
                "misfit_degC": circuit.misfit_degC,
                "evaluations": circuit.evaluations,
            },
            # what is not fitted; the recipe names where each number comes from
            "declared": recipe.model_dump(mode="json", exclude={"format", "version", "name", "about"}),
        },
        notes=(
            f"Noise gain: {main['noise_gain']:.2f}, the secondary's {other['noise_gain']:.2f} (output per unit of "
            f"white noise in every sensor, at {fit.periods_s[0]:g} s).",
            f"Time constants: {_times(main['time_constants_s'])}; the secondary's {_times(other['time_constants_s'])}.",
            f"Secondary: blended in from {threshold_degC:.2f} degC of difference on, alone from twice it.",
            *closing_notes(half, fit.fallbacks),
            f"Forward circuit {recipe.circuit} misses the sensors by (RMS) {misfit} degC.",
            f"Declared, not fitted: unmeasured heat ({', '.join(recipe.unlogged.patterns)}), synthetic ambient and "
            "work, weights.",
        ),
    )


def _filter(fit: Fit) -> dict[str, Any]:
    taus = sorted(-1 / np.linalg.eigvals(fit.system.A), key=abs, reverse=True)
    return {
        "noise_gain": noise_gain(fit.system, fit.periods_s[0]),
        "period_s": fit.periods_s[0],
        "time_constants_s": [[tau.real, tau.imag] for tau in map(complex, taus)],
        "gains_at_rest": dict(zip(fit.inputs, fit.dc_gains)),
        "converged": fit.converged,
    }


def _times(constants_s: Sequence[Sequence[float]]) -> str:
    """Time constants as text, a damped pair as one."""
    shown = [f"{real:.0f}" if not imaginary else f"{real:.0f} ± {imaginary:.0f}j" for real, imaginary in constants_s]
    return f"{', '.join(each for each, (_, imaginary) in zip(shown, constants_s) if imaginary >= 0)} s"


_STATES = 4
_MOST_RATIO = 20.0
_MOST_DAMPING = 20.0
_LOGGED_S, _SYNTHETIC_S = 7.0, 11.0
"""One sample in so long is compared: neighbours repeat each other."""


def recipe_filter(runs: TrainingSet, counts: Mapping[str, float], rules: FilterRules, period_s: float) -> FreeFilter:
    """The filter of four states over the runs that ``counts`` weighs, within the bounds of ``rules``."""
    weighted = []
    for name, count in counts.items():
        stride = max(1, round((_LOGGED_S if name == LOGGED else _SYNTHETIC_S) / period_s))
        for run in runs[name] if count else ():
            target = np.full_like(run.outputs, np.nan)
            target[:, ::stride] = run.outputs[:, ::stride]
            weight = math.sqrt(count / len(runs[name]) / len(target[0, ::stride]))
            # the circuit's residuals know nothing of the filter's offset
            weighted.append(WeightedRun(replace(run, outputs=target), weight, name != RESIDUAL))
    unit_gain, noise = math.sqrt(rules.one_degree), math.sqrt(rules.noise)
    found = weighted_filter(_STATES, weighted, unit_gain, noise, rules.offset_degC)
    slow, fast = sorted(rules.slow.time_constants_s), rules.fast
    # two rates r and r q: omega^2 = r^2 q, zeta = (1 + q) / (2 sqrt q) = cosh(log q / 2)
    found.search = Unknowns(
        found.search.names,
        np.log([1 / math.sqrt(slow[0] * slow[1]), _damping(slow[1] / slow[0]), 1 / fast.time_s, fast.damping]),
        np.log([1 / rules.slow.slowest_s, _damping(rules.slow.least_ratio)] * 2),
        np.log([1 / (2 * period_s), _damping(_MOST_RATIO), 1 / (2 * period_s), _MOST_DAMPING]),
    )
    found.search.low[3] = math.log(fast.least_damping)
    found.slowest = -math.log(rules.slow.slowest_s)
    return found


def _damping(ratio: float) -> float:
    """The damping of two real poles of that ratio."""
    return math.cosh(math.log(ratio) / 2)


def published(fit: Fit, segment: Segment) -> Blended:
    """The estimate of a fit blended with its secondary one's, over a segment."""
    assert fit.secondary is not None
    return blended(fit.over(segment), fit.secondary.fit.over(segment), fit.secondary.threshold_degC)


def fit_filters(recipe: Recipe, runs: TrainingSet, log: Training, effort: Effort, progress: Progress) -> Fit:
    """The main filter with its secondary one and fallbacks; ``progress`` gets the number of the search.

    Cancelled, it leaves out the fallbacks that are not done; before the first it raises :class:`Cancelled`.
    """
    weights, period_s = recipe.weights, log.segments[0].period_s
    start: Array | None = None

    def fitted(number: int, counts: Mapping[str, float], without: int | None = None) -> Fit:
        nonlocal start
        kept = [index for index in range(len(log.columns)) if index != without]
        fewer = {name: [each.of(kept) for each in several] for name, several in runs.items()}
        structure = recipe_filter(fewer, counts, recipe.filter, period_s)
        if start is not None:
            structure.search = replace(structure.search, initial=start)
        result = search(structure, 1, effort.seed, lambda _, *rest: progress(number, *rest), effort.budget)
        start = result.best.theta if start is None else start
        return filter_fit(recipe.name, log if without is None else log.without(without), _STATES, result, effort)

    main = fitted(0, weights.main)
    secondary = fitted(1, weights.secondary)
    effort.budget.check()
    fallbacks, _ = fallbacks_of(main, lambda index: fitted(2 + index, weights.main, index))
    differences = np.concatenate([main.over(each) - secondary.over(each) for each in log.segments])
    threshold = recipe.threshold.times * float(np.percentile(np.abs(differences), recipe.threshold.percent))
    stopped = len(fallbacks) < len(recipe.sensors)
    return replace(main, secondary=SecondaryFit(secondary, threshold), fallbacks=fallbacks, stopped=stopped)


def unseen(recipe: Recipe, fit: Fit, runs: TrainingSet) -> list[Moment]:
    """The estimate of ``fit`` over ``runs``, which the recipe weighs, with a reference every 11 s."""
    moments = []
    for name, count in recipe.weights.interval.items():
        for run in runs[name]:
            estimate, _, apart = published(fit, run)
            counted = np.arange(len(estimate)) % max(1, round(_SYNTHETIC_S / run.period_s)) == 0
            weight = count / len(runs[name]) / int(counted.sum())
            moments.append(Moment(estimate, np.where(counted, run.outputs[0], np.nan), apart, weight))
    return moments
