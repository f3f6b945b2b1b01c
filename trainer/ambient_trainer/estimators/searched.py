"""A search's end becomes a fit: the system, what is known of each unknown, and the errors it leaves."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from ambient_trainer.data.trace import Array
from ambient_trainer.estimation.free_filter import FreeFilter
from ambient_trainer.estimation.search import SearchResult
from ambient_trainer.estimation.static_linear import fit_static_linear
from ambient_trainer.estimation.structure import Structure
from ambient_trainer.estimation.uncertainty import Uncertainty, residuals, uncertainty
from ambient_trainer.estimators.base import Effort, Fit, ParameterEstimate
from ambient_trainer.lti.statespace import Hold, StateSpace

_OPEN = float(np.log(1e3))
"""Half a 95 % interval, as a logarithm, from which on it says no more than that the parameter is positive."""
MODES = ("mode1", "mode2", "mode3", "mode4")
"""The states of a filter that no circuit names."""


def fit_of(
    structure: Structure,
    result: SearchResult,
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


def filter_unknowns(structure: FreeFilter, theta: Array) -> list[tuple[str, str, float, bool]]:
    """The poles of a free filter as unknowns of :func:`fit_of`."""
    units = ["1" if "zeta" in name else "1/s" for name in structure.search.names]
    return [
        (name, unit, value, True) for name, unit, value in zip(structure.search.names, units, np.exp(theta).tolist())
    ]


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
