"""Conversion of a search's result to a fit: the system, its parameters' uncertainty, and its errors."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ambient_model.model import Beyond
from ambient_model.trace import split_column
from ambient_trainer.data import Segment
from ambient_trainer.estimation import FreeFilter, MultistartResult, Progress, Structure
from ambient_trainer.estimation.error_variance import Moment, fit_error_variance, half_widths
from ambient_trainer.estimation.uncertainty import Uncertainty, residuals, uncertainty
from ambient_trainer.estimators.base import Effort, Fit, ParameterEstimate, Training, fit_static_linear
from ambient_trainer.lti import Hold, StateSpace, dc_gain, noise_gain

_OPEN = float(np.log(1e3))
"""Half a 95 % interval, as a logarithm, from which on it says no more than that the parameter is positive."""
_BEYOND = 0.5
"""Of how far an estimate lies outside of all that training has estimated: its error's standard deviation there."""
MODES = ("mode1", "mode2", "mode3", "mode4")
"""The states of a filter that no circuit names."""


def fit_of(
    structure: Structure,
    result: MultistartResult,
    effort: Effort,
    system: StateSpace,
    unknowns: Iterable[tuple[str, str, float, bool]],
    circuit: str,
    inputs: Sequence[str],
    states: Sequence[str],
    hold: Hold = "first-order",
    outputs: Sequence[str] = ("ambient",),
) -> Fit:
    """The fit of what was searched, with the uncertainty under ``structure``, which need not be the searched one.

    ``system`` is the structure's in the user's terms, and so are the ``unknowns``: name, unit, value, and whether it
    was searched as a logarithm.
    """
    known = uncertainty(structure, result.best)
    parameters = tuple(_estimated(*each, known) for each in unknowns)
    errors = [row[~np.isnan(row)] for row in np.concatenate(residuals(structure, result.best), axis=1)]
    inputs_seen = np.concatenate([segment.inputs for segment in structure.segments], axis=1)
    count = sum(len(each) for each in errors)
    free = [each for each in parameters if each.free]
    determined = [each for each in free if each.identifiable and not each.at_bound]
    return Fit(
        circuit=circuit,
        system=system,
        hold=hold,
        inputs=tuple(inputs),
        states=tuple(states),
        outputs=tuple(outputs),
        periods_s=tuple(sorted({segment.period_s for segment in structure.segments})),
        parameters=parameters,
        converged=result.best.converged and not result.stopped,
        uncertainty_available=bool(determined) and all(each.interval95 is not None for each in determined),
        identifiable=bool(known.identifiable.all()) and all(each.identifiable for each in free),
        stopped=result.stopped,
        confounded=known.confounded,
        residual_memory_samples=known.residual_memory_samples,
        rmse_degC=float(np.sqrt(result.best.sum_of_squares / count)),
        start_rmses_degC=tuple(float(np.sqrt(each.sum_of_squares / count)) for each in result.starts),
        evaluations=result.evaluations,
        effort=effort,
        errors_degC=tuple(errors),
        baseline=fit_static_linear(structure.segments),
        input_ranges=tuple((float(row.min()), float(row.max())) for row in inputs_seen),
    )


def _estimated(name: str, unit: str, value: float, logarithmic: bool, known: Uncertainty) -> ParameterEstimate:
    if name not in known.names:
        return ParameterEstimate(name, unit, value, None, None, free=False, at_bound=False, identifiable=True)
    index = known.names.index(name)
    error = float(known.standard_error[index])
    bound, identifiable = bool(known.at_bound[index]), bool(known.identifiable[index])
    half = known.quantile * error
    vague = logarithmic and half > _OPEN
    if np.isnan(error) or vague:
        return ParameterEstimate(name, unit, value, None, None, True, bound, identifiable and not vague)
    interval = (value - half, value + half)
    if logarithmic:
        error, factor = value * error, float(np.exp(half))
        interval = (value / factor, value * factor)
    return ParameterEstimate(name, unit, value, error, interval, True, bound, identifiable)


def filter_fit(
    name: str, training: Training, order: int, result: MultistartResult, effort: Effort, unit_gain: bool = True
) -> Fit:
    """The fit of a free filter that was searched over the log, or over more.

    Its DC gains add up to one where ``unit_gain`` was demanded.
    """
    logged = FreeFilter(order, training.segments)
    system = logged.system(result.best.theta, result.best.beta)
    lacking = (1.0 - float(dc_gain(system)[0].sum())) * unit_gain
    system = replace(system, D=system.D + lacking / system.D.shape[1])
    poles = zip(logged.search.names, np.exp(result.best.theta).tolist())
    unknowns = [(pole, "1" if "zeta" in pole else "1/s", value, True) for pole, value in poles]
    fit = fit_of(logged, result, effort, system, unknowns, name, training.columns, MODES[:order])
    return rescored(fit, training.segments)


def rescored(fit: Fit, segments: Sequence[Segment]) -> Fit:
    """The fit with the errors of the system that it exports, which is not quite the one that was searched."""
    errors = np.concatenate([each.outputs[0] - fit.over(each) for each in segments])
    errors = errors[~np.isnan(errors)]
    rmse_degC = float(np.sqrt(np.mean(errors**2)))
    starts = tuple(each * rmse_degC / fit.rmse_degC for each in fit.start_rmses_degC)
    return replace(fit, errors_degC=(errors,), rmse_degC=rmse_degC, start_rmses_degC=starts)


def with_fallbacks_and_variance(
    fit: Fit,
    segments: Sequence[Segment],
    unseen: Sequence[Moment],
    refit: Callable[[int], Fit] | None,
    remark: str,
    details: Mapping[str, Any],
    offset_degC: float = 0.0,
) -> Fit:
    """The fit with a fallback an input, if there is a ``refit``, and an error variance model.

    Its errors are those of ``unseen`` blocks, if there are any. Blocks that are alike do not show an offset of the
    sensors: where the data do not exclude one of ``offset_degC`` (a standard deviation), the constant is at least what
    the DC gains make of it. ``remark`` and ``details`` are of this kind of observer. Cancelled, it leaves out the
    fallbacks that are not done.
    """
    fallbacks, stopped = fallbacks_of(fit, refit)
    moments = [Moment(fit.over(each), each.outputs[0]) for each in segments]
    period_s = segments[0].period_s
    variance = fit_error_variance(unseen or moments, period_s)
    still_degC2 = offset_degC**2 * sum(gain**2 for gain in fit.dc_gains)
    estimates = np.concatenate([each.estimate_degC for each in moments])
    variance = variance._replace(
        constant_degC2=max(variance.constant_degC2, still_degC2),
        beyond=Beyond(float(np.nanmin(estimates)), float(np.nanmax(estimates)), _BEYOND**2),
    )
    gain = noise_gain(fit.system, period_s)
    half = half_widths(variance, moments, period_s)
    return replace(
        fit,
        fallbacks=fallbacks,
        error_variance=variance,
        stopped=fit.stopped or stopped,
        converged=fit.converged and not stopped,
        details={
            **details,
            "noise_gain": gain,
            "half_width_90_degC": half,
            "fallbacks": {name: {"rmse_degC": each.rmse_degC} for name, each in fallbacks.items()},
        },
        notes=(
            remark,
            f"Noise gain: {gain:.2f} (output per unit of white noise in every sensor, at {period_s:g} s).",
            *closing_notes(half, fallbacks),
        ),
    )


def closing_notes(half_degC: Mapping[str, float], fallbacks: Mapping[str, Fit]) -> list[str]:
    """Lines on the width of the 90 % interval, by the share of samples over which it is narrower, and on fallbacks."""
    quiet, usual, fast, fastest = (f"{half_degC[share]:.2f}" for share in ("10", "50", "90", "99"))
    notes = [
        f"Half of the 90 % interval: {usual} degC over the median training sample, {quiet} at the quietest (10 %), "
        f"{fast} in transients (90 %), {fastest} in the fastest (99 %)."
    ]
    if fallbacks:
        without = ", ".join(f"{name} {each.rmse_degC:.2f}" for name, each in fallbacks.items())
        notes.append(f"Without a sensor, RMSE on the training samples: {without}.")
    return notes


def late(progress: Progress | None, effort: Effort) -> Progress | None:
    """The progress of a search that follows after all starts."""
    return progress and (lambda _, evaluation, square: progress(effort.starts, evaluation, square))


def fallbacks_of(fit: Fit, refit: Callable[[int], Fit] | None) -> tuple[dict[str, Fit], bool]:
    """The fallbacks by input as far as they were done, and whether they were cancelled."""
    if refit is None or len(fit.inputs) < 2 or fit.stopped:
        return {}, False
    fallbacks: dict[str, Fit] = {}
    for index, column in enumerate(fit.inputs):
        each = refit(index)
        if each.stopped:
            return fallbacks, True
        fallbacks[split_column(column)[0]] = each
    return fallbacks, False
