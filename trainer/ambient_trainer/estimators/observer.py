"""What an observer's fit has beside its filter: errors of the exported system, fallbacks, and an error variance model.

The remarks of the figures that follow stand here, too.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ambient_model.trace import split_column
from ambient_trainer.data.grid import Segment
from ambient_trainer.estimation.error_variance import Moment, fit_error_variance, half_widths
from ambient_trainer.estimation.free_filter import FreeFilter
from ambient_trainer.estimation.search import Progress, SearchResult
from ambient_trainer.estimators.base import Effort, Fit
from ambient_trainer.estimators.searched import MODES, filter_unknowns, fit_of
from ambient_trainer.lti.response import noise_gain
from ambient_trainer.lti.statespace import dc_gain

Refit = Callable[[int], Fit]
"""Fits the same without the input of that number."""


def filter_fit(
    name: str, columns: Sequence[str], segments: Sequence[Segment], order: int, result: SearchResult, effort: Effort
) -> Fit:
    """The fit of a free filter that was searched over more than the logged ``segments``; its DC gains add up to one."""
    logged = FreeFilter(order, segments)
    system = logged.system(result.best.theta, result.best.beta)
    lacking = 1.0 - float(dc_gain(system)[0].sum())
    system = replace(system, D=system.D + lacking / system.D.shape[1])
    unknowns = filter_unknowns(logged, result.best.theta)
    return rescored(fit_of(logged, result, effort, system, unknowns, name, columns, MODES[:order]), segments)


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
    refit: Refit | None,
    remark: str,
    details: Mapping[str, Any],
) -> Fit:
    """The fit with a fallback an input, if there is a ``refit``, and an error variance model.

    Its errors are those of ``unseen`` blocks, if there are any. ``remark`` and ``details`` are of this kind
    of observer. Cancelled, it leaves out the fallbacks that are not done.
    """
    fallbacks, stopped = fallbacks_of(fit, refit)
    moments = [Moment(fit.over(each), each.outputs[0]) for each in segments]
    period_s = segments[0].period_s
    variance = fit_error_variance(unseen or moments, period_s)
    gain = noise_gain(fit.system, period_s)
    half = half_widths(variance, [(each.estimate_degC, 0 * each.estimate_degC) for each in moments], period_s)
    rmses = {name: each.rmse_degC for name, each in fallbacks.items()}
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
            "fallbacks": {name: {"rmse_degC": rmse} for name, rmse in rmses.items()},
        },
        notes=(
            remark,
            f"Noise gain: {gain:.2f} (output per unit of white noise in every sensor, at {period_s:g} s).",
            half_width_note(half),
            *fallback_notes(rmses),
        ),
    )


_SHARES = {"10": "at the quietest (10 %)", "90": "in transients (90 %)", "99": "in the fastest (99 %)"}


def half_width_note(half_degC: Mapping[str, float]) -> str:
    """A line on the width of the 90 % interval, by the percentage of samples over which it is narrower."""
    others = ", ".join(f"{half_degC[share]:.2f} {words}" for share, words in _SHARES.items())
    return f"Half of the 90 % interval: {half_degC['50']:.2f} degC over the median training sample, {others}."


def fallback_notes(rmses_degC: Mapping[str, float]) -> list[str]:
    """A line on what each fallback leaves, if there is any."""
    each = ", ".join(f"{name} {rmse:.2f}" for name, rmse in rmses_degC.items())
    return [f"Without a sensor, RMSE on the training samples: {each}."] if each else []


def late(progress: Progress | None, effort: Effort) -> Progress | None:
    """The progress of a search that follows after all starts."""
    return progress and (lambda _, evaluation, square: progress(effort.starts, evaluation, square))


def fallbacks_of(fit: Fit, refit: Refit | None) -> tuple[dict[str, Fit], bool]:
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
