"""What was found is scored on traces that had no say, from a cold start at the first sample of each stretch."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ambient_model.faults import refuse
from ambient_model.trace import REFERENCE
from ambient_trainer.data.trace import Trace
from ambient_trainer.estimators.estimate import estimate_degC
from ambient_trainer.lti.statespace import Hold, StateSpace
from ambient_trainer.selection.found import Check, Chosen, Found
from ambient_trainer.selection.screen import Sensor

Array = NDArray[np.float64]


def fit_to_check(trace: Trace, sensors: Sequence[Sensor]) -> None:
    """Refuse, before any work, a trace on which not every one of ``sensors`` could be scored."""
    if np.isnan(trace.reference).all():
        raise refuse(trace.path, f"column {REFERENCE}", "holds no value at all", "log it, or check another trace")
    absent = [each.column for each in sensors if each.column not in trace.columns]
    if absent:
        raise refuse(trace.path, "line 1", f"no column {', '.join(absent)}", "check a trace of the same device")


def checked(found: Found, trace: Trace) -> Check:
    """Everything that was found, on ``trace``."""
    against = found.against
    return Check(
        path=trace.path,
        filters=tuple(_filter_rmse(each, trace) for each in found.sizes),
        free=tuple(_free_rmse(each, trace) for each in found.sizes),
        circuits={
            size: _system_rmse(each.system, each.circuit.hold, each.circuit.inputs, trace)
            for size, each in found.circuits.items()
        },
        against=(_filter_rmse(against, trace), _free_rmse(against, trace)) if against else None,
    )


def _filter_rmse(chosen: Chosen, trace: Trace) -> float:
    return _system_rmse(chosen.filter.system, "first-order", chosen.free.columns, trace)


def _free_rmse(chosen: Chosen, trace: Trace) -> float:
    return _system_rmse(chosen.free.system, "first-order", chosen.free.columns, trace)


def _system_rmse(system: StateSpace, hold: Hold, columns: Sequence[str], trace: Trace) -> float:
    return _rmse(trace.reference - estimate_degC(system, hold, columns, trace))


def _rmse(errors: Array) -> float:
    return float(np.sqrt(np.nanmean(errors**2)))
