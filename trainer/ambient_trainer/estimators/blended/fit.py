"""Traces and an observer's recipe become a fit like any circuit's, with a guard, fallbacks and a spread."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from ambient_model.faults import refuse
from ambient_model.model import Spread
from ambient_model.trace import REFERENCE
from ambient_trainer.circuits.circuit import Circuit
from ambient_trainer.data.grid import Segment, sampling_period_s, segments
from ambient_trainer.data.trace import Trace
from ambient_trainer.estimation.error_variance import sigma_degC
from ambient_trainer.estimation.search import Progress
from ambient_trainer.estimation.static_linear import fit_static_linear
from ambient_trainer.estimation.uncertainty import residual_memory
from ambient_trainer.estimators.blended.bank import Bank, taught
from ambient_trainer.estimators.blended.forward_fit import Forward, ForwardFit, Record, fit_forward
from ambient_trainer.estimators.blended.interval import fit_spread
from ambient_trainer.estimators.blended.recipe import Recipe
from ambient_trainer.estimators.blended.summary import figures, notes
from ambient_trainer.estimators.blended.synthetic_ambient import learn_weather
from ambient_trainer.estimators.blended.synthetic_load import learn_workload
from ambient_trainer.estimators.blended.trained_filter import STATES, TaughtFilter
from ambient_trainer.estimators.blended.training_set import Classroom
from ambient_trainer.estimators.fit import Effort, Estimated, Fit, GuardFit, refuse_untaught

Array = NDArray[np.float64]

_CIRCUIT_PERIOD_S = 5.0
"""Nothing that the circuit holds is faster; its fit is the faster for it."""
_FEWEST_SAMPLES = 1000


def searches(recipe: Recipe) -> int:
    """How many searches a fit is: the circuit's, the main filter's, the guard's and one a fallback."""
    return 3 + len(recipe.sensors)


def fit_observer(
    recipe: Recipe,
    circuit: Circuit,
    traces: Sequence[Trace],
    effort: Effort,
    progress: Progress | None = None,
    period_s: float | None = None,
) -> Fit:
    """Fit the observer to one or several traces.

    One search each, from where the recipe says: ``effort.starts`` is not used, its seed draws the synthetic runs.
    Cancelled, it leaves out the fallbacks that are not done; before the first it raises :class:`Cancelled`.
    Raises :class:`Refused` where the traces lack a column, are too short or hold no work.
    """
    period = period_s or max(sampling_period_s(trace.time_s) for trace in traces)
    records = _records(recipe, traces, period, effort.pieces)
    finer = max(1, round(_CIRCUIT_PERIOD_S / period))
    source = ", ".join(trace.path for trace in traces)
    samples = sum(len(each.ambient_degC) for each in records)

    def stage(number: int) -> Callable[[int, float], None]:
        def told(evaluation: int, square: float) -> None:
            if progress is not None:
                progress(number, evaluation, square * samples)
            effort.budget.cancel.check()

        return told

    with threadpool_limits(1):
        coarse = [each.every(finer) for each in records]
        # what a log lacks is said before anything is searched
        weather = learn_weather([each.ambient_degC for each in coarse], finer * period, source)
        workload = learn_workload(coarse, recipe.work, source)
        forward = Forward(recipe, circuit)
        fit = fit_forward(forward, coarse, finer * period, stage(0))
        classroom = Classroom(recipe, forward, fit, weather, workload, finer * period, finer, effort.seed)
        bank = taught(recipe, classroom.lessons(records), period, lambda number: stage(1 + number))
        # filters err less in the very runs that taught them
        spread = fit_spread(recipe, bank, replace(classroom, term=1).lessons(records))
    return _closed(recipe, bank, fit, spread, records, effort)


def _records(recipe: Recipe, traces: Sequence[Trace], period_s: float, pieces: int) -> list[Record]:
    """The log without gaps, at ``period_s``, each piece to be started cold."""
    refuse_untaught(traces, recipe.sensor_columns, (REFERENCE,))
    columns = [*recipe.sensor_columns, REFERENCE, *recipe.drive_columns]
    found = []
    for trace in traces:
        for segment in segments(trace, columns, (), period_s):
            found += [record_of(recipe, dict(zip(columns, piece.inputs))) for piece in segment.pieces(pieces)]
    samples = sum(len(each.ambient_degC) for each in found)
    if samples < _FEWEST_SAMPLES:
        source = ", ".join(trace.path for trace in traces)
        mend = "log hours, at 1 s, with work, pauses and an ambient that moves"
        raise refuse(source, "", f"{samples} samples teach no observer", mend)
    return found


def record_of(recipe: Recipe, rows: Mapping[str, Array]) -> Record:
    """What the recipe makes of trace columns (N,)."""
    heat = recipe.heat
    measured, shared = (
        np.sum([watts * rows[column] for column, watts in each.watts.items()], axis=0)
        for each in (heat.measured, heat.shared)
    )
    sensors = np.vstack([rows[column] for column in recipe.sensor_columns])
    return Record(sensors, rows[REFERENCE], measured, shared, rows[recipe.work.signal])


def _closed(
    recipe: Recipe, bank: Bank, circuit: ForwardFit, spread: Spread, records: Sequence[Record], effort: Effort
) -> Fit:
    """The main filter's fit, whose errors are those of what main and guard publish, with all that belongs to it."""
    published = [bank.published(each.sensors_degC) for each in records]
    guard = _alone(recipe, bank.guard, records, effort)
    fallbacks = {name: _alone(recipe, each, records, effort) for name, each in bank.fallbacks.items()}
    sigmas = np.concatenate(
        [sigma_degC(spread, each.ambient_degC, each.apart_degC, bank.main.period_s) for each in published]
    )
    told = figures(recipe, bank, circuit, spread, sigmas, {name: each.rmse_degC for name, each in fallbacks.items()})
    main = _fit(recipe, bank.main, [each.ambient_degC for each in published], records, effort)
    members = [bank.main, bank.guard, *bank.fallbacks.values()]
    return replace(
        main,
        converged=circuit.converged and all(each.found.converged for each in members) and not bank.stopped,
        stopped=bank.stopped,
        evaluations=circuit.evaluations + sum(each.found.evaluations for each in members),
        guard=GuardFit(guard, bank.threshold_degC),
        fallbacks=fallbacks,
        spread=spread,
        figures=told,
        notes=notes(told),
    )


def _alone(recipe: Recipe, each: TaughtFilter, records: Sequence[Record], effort: Effort) -> Fit:
    picks = [recipe.sensor_columns.index(column) for column in each.inputs]
    estimates = [each.estimate_degC(record.sensors_degC[picks]) for record in records]
    return _fit(recipe, each, estimates, records, effort)


def _fit(
    recipe: Recipe, taught: TaughtFilter, estimates: Sequence[Array], records: Sequence[Record], effort: Effort
) -> Fit:
    """A filter that says ``estimates`` over ``records``."""
    picks = [recipe.sensor_columns.index(column) for column in taught.inputs]
    inputs = [record.sensors_degC[picks] for record in records]
    errors = np.concatenate([record.ambient_degC - said for record, said in zip(records, estimates)])
    logged = [Segment(taught.period_s, u, record.ambient_degC[None]) for u, record in zip(inputs, records)]
    rmse = float(np.sqrt(np.mean(errors**2)))
    return Fit(
        circuit=recipe.name,
        system=taught.system(),
        hold="first-order",
        inputs=taught.inputs,
        states=tuple(f"mode{index + 1}" for index in range(STATES)),
        outputs=("ambient",),
        periods_s=(taught.period_s,),
        parameters=_parameters(taught),
        converged=taught.found.converged,
        uncertainty_available=False,
        identifiable=taught.found.told,
        stopped=False,
        confounded=(),
        residual_memory_samples=residual_memory(errors),
        rmse_degC=rmse,
        start_rmses_degC=(rmse,),
        evaluations=taught.found.evaluations,
        effort=effort,
        errors_degC=(errors,),
        baseline=fit_static_linear(logged),
        input_ranges=tuple((float(row.min()), float(row.max())) for row in np.concatenate(inputs, axis=1)),
    )


def _parameters(taught: TaughtFilter) -> tuple[Estimated, ...]:
    """The poles: the search's unknowns in units that say something."""
    (slow_omega, slow_zeta), (omega, zeta) = np.exp(taught.found.poles).reshape(-1, 2).tolist()
    root = float(np.sqrt(max(slow_zeta**2 - 1, 0.0)))
    values = {
        ("tau1", "s"): (slow_zeta + root) / slow_omega,
        ("tau2", "s"): (slow_zeta - root) / slow_omega,
        ("omega", "1/s"): omega,
        ("zeta", "1"): zeta,
    }
    return tuple(
        Estimated(name, unit, value, None, None, free=True, at_bound=bound, identifiable=taught.found.told)
        for ((name, unit), value), bound in zip(values.items(), taught.found.at_bound)
    )
