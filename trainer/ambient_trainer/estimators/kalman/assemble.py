"""What every observer gets once its filter is found: errors of what is exported, fallbacks, a spread, and remarks."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambient_model.trace import split_column
from ambient_trainer.data.grid import Segment
from ambient_trainer.estimation.error_variance import Moment, fit_spread, half_widths
from ambient_trainer.estimation.search import Progress
from ambient_trainer.estimators.fit import Effort, Fit
from ambient_trainer.lti.noise_gain import noise_gain
from ambient_trainer.lti.response import response_degC

Array = NDArray[np.float64]

Refit = Callable[[int], Fit]
"""Fits the same without the input of that number."""


class Member(NamedTuple):
    """A fit and what it was fitted to."""

    fit: Fit
    segments: Sequence[Segment]


class Told(NamedTuple):
    """What one kind of observer alone has to tell, as a line and as figures."""

    remark: str
    figures: Mapping[str, Any]


def judged(fit: Fit, segments: Sequence[Segment]) -> Fit:
    """The fit with the errors of the system that it exports."""
    errors = np.concatenate([each.outputs[0] - _estimate(fit, each) for each in segments])
    errors = errors[~np.isnan(errors)]
    rmse_degC = float(np.sqrt(np.mean(errors**2)))
    # the starts were judged by what the search minimised
    starts = tuple(each * rmse_degC / fit.rmse_degC for each in fit.start_rmses_degC)
    return replace(fit, errors_degC=(errors,), rmse_degC=rmse_degC, start_rmses_degC=starts)


def without(columns: Sequence[str], segments: Sequence[Segment], dropped: int) -> tuple[list[str], list[Segment]]:
    """The columns and segments without one input."""
    kept = [index for index in range(len(columns)) if index != dropped]
    return [columns[index] for index in kept], [
        Segment(each.period_s, each.inputs[kept], each.outputs) for each in segments
    ]


def finished(main: Member, refit: Refit | None, told: Told) -> Fit:
    """The fit with a fallback an input, if there is a ``refit``, a spread and what there is to tell of them.

    Cancelled, it leaves out the fallbacks that are not done.
    """
    fit, segments = main
    fallbacks, stopped = _fallbacks(fit, refit)
    moments = [Moment(_estimate(fit, each), each.outputs[0]) for each in segments]
    period_s = segments[0].period_s
    spread = fit_spread(moments, period_s)
    figures = {
        "noise_gain": noise_gain(fit.system, period_s),
        "half_width_90_degC": half_widths(spread, moments, period_s),
        "fallbacks": {name: {"rmse_degC": each.rmse_degC} for name, each in fallbacks.items()},
    }
    return replace(
        fit,
        fallbacks=fallbacks,
        spread=spread,
        stopped=fit.stopped or stopped,
        converged=fit.converged and not stopped,
        figures={**told.figures, **figures},
        notes=(told.remark, *_notes(figures, period_s)),
    )


def _notes(figures: Mapping[str, Any], period_s: float) -> list[str]:
    half = figures["half_width_90_degC"]
    said = [
        f"Noise gain: {figures['noise_gain']:.2f} (output per unit of white noise in every sensor, at {period_s:g} s).",
        f"Half of the 90 % interval: {half['50']:.2f} degC over the median training sample, {half['10']:.2f} when "
        f"quiet (10 %), {half['90']:.2f} in transients (90 %), {half['99']:.2f} in the fastest (99 %).",
    ]
    if figures["fallbacks"]:
        each = ", ".join(f"{name} {found['rmse_degC']:.2f}" for name, found in figures["fallbacks"].items())
        said.append(f"Without a sensor, RMSE on the training samples: {each}.")
    return said


def late(progress: Progress | None, effort: Effort) -> Progress | None:
    """The progress of a search that follows after all starts."""
    return progress and (lambda _, evaluation, square: progress(effort.starts, evaluation, square))


def _fallbacks(fit: Fit, refit: Refit | None) -> tuple[dict[str, Fit], bool]:
    """By input, and whether the user stopped it."""
    if refit is None or len(fit.inputs) < 2 or fit.stopped:
        return {}, False
    found: dict[str, Fit] = {}
    for index, column in enumerate(fit.inputs):
        each = refit(index)
        if each.stopped:
            return found, True
        found[split_column(column)[0]] = each
    return found, False


def _estimate(fit: Fit, segment: Segment) -> Array:
    return response_degC(fit.system, fit.hold, segment.inputs, segment.period_s)
