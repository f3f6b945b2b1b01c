"""A search's end becomes a fit: the system, what is known of each unknown, and the errors it leaves."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ambient_trainer.estimation.free_filter import FreeFilter
from ambient_trainer.estimation.least_squares import fit_static_linear
from ambient_trainer.estimation.search import Progress, SearchResult, search
from ambient_trainer.estimation.structure import Structure
from ambient_trainer.estimation.uncertainty import Uncertainty, residuals, uncertainty
from ambient_trainer.estimators.base import Effort, Fit, ParameterEstimate
from ambient_trainer.lti.statespace import Hold, StateSpace

_OPEN = float(np.log(1e3))
"""Half a 95 % interval, as a logarithm, from which on it says no more than that the parameter is positive."""
MODES = ("mode1", "mode2", "mode3", "mode4")
"""The states of a filter that no circuit names."""


class Searched(NamedTuple):
    """What a search ended with, in the structure's own terms."""

    structure: Structure
    result: SearchResult
    known: Uncertainty
    effort: Effort


def searched(structure: Structure, effort: Effort, progress: Progress | None) -> Searched:
    """Search, and compute the uncertainty of the best."""
    return with_uncertainty(structure, search(structure, effort.starts, effort.seed, progress, effort.budget), effort)


def with_uncertainty(structure: Structure, result: SearchResult, effort: Effort) -> Searched:
    """A search's result with its uncertainty under ``structure``, which need not be the one that was searched."""
    return Searched(structure, result, uncertainty(structure, result.best), effort)


def fit_of(
    found: Searched,
    system: StateSpace,
    parameters: Sequence[ParameterEstimate],
    *,
    circuit: str,
    inputs: Sequence[str],
    states: Sequence[str],
    hold: Hold = "first-order",
    outputs: Sequence[str] = ("ambient",),
) -> Fit:
    """The fit of what was searched; ``system`` and ``parameters`` are the structure's, in the user's terms."""
    structure, result, known, effort = found
    per_segment = residuals(structure, result.best)
    errors = [np.concatenate([each[output] for each in per_segment]) for output in range(len(outputs))]
    errors = [each[~np.isnan(each)] for each in errors]
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
        parameters=tuple(parameters),
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


def estimated(name: str, unit: str, value: float, logarithmic: bool, known: Uncertainty) -> ParameterEstimate:
    """One unknown of a fit; ``logarithmic`` where it was searched as a logarithm."""
    if name not in known.names:
        return ParameterEstimate(name, unit, value, None, None, free=False, at_bound=False, identifiable=True)
    index = known.names.index(name)
    error = float(known.standard_error[index])
    bound, identifiable = bool(known.at_bound[index]), bool(known.identifiable[index])
    half = known.quantile * error
    vague = logarithmic and half > _OPEN
    if np.isnan(error) or vague:
        return ParameterEstimate(name, unit, value, None, None, True, bound, identifiable and not vague)
    if logarithmic:
        factor = float(np.exp(half))
        interval = (value / factor, value * factor)
        return ParameterEstimate(name, unit, value, value * error, interval, True, bound, identifiable)
    return ParameterEstimate(name, unit, value, error, (value - half, value + half), True, bound, identifiable)


def filter_parameters(structure: FreeFilter, found: Searched) -> tuple[ParameterEstimate, ...]:
    """The poles of a free filter as parameters."""
    values = np.exp(found.result.best.theta).tolist()
    return tuple(
        estimated(name, "1" if "zeta" in name else "1/s", value, True, found.known)
        for name, value in zip(structure.search.names, values)
    )
