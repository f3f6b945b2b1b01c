"""Which samples a method uses: those that hold every column it reads; at any other it has no estimate."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from ambient_model.faults import Fault, Refused, refuse
from ambient_model.trace import REFERENCE
from ambient_trainer.data.trace import Array, Trace


class Samples(NamedTuple):
    """Times in s (n,), one row a column (m, n) without gaps, the ambient in degC (n,), NaN where unknown."""

    time_s: Array
    rows: Array
    ambient_degC: Array


def require(trace: Trace, columns: Sequence[str]) -> None:
    """Refuse a trace that lacks some of ``columns``, naming all of them."""
    missing = [name for name in columns if name not in trace.columns]
    if missing:
        mend = f"the trace has {', '.join(trace.columns)}; log it or map it on import"
        raise Refused(trace.path, [Fault("line 1", f"no column '{name}'", mend) for name in missing])


def estimated(trace: Trace, columns: Sequence[str], estimate: Callable[[Array, Array], Array]) -> Array:
    """``estimate(time_s, rows)`` of the samples that hold all ``columns``, NaN at the others; shape (n,)."""
    require(trace, columns)
    rows = np.vstack([trace.columns[name] for name in columns])
    complete = ~np.isnan(rows).any(axis=0)
    result = np.full(len(trace.time_s), np.nan)
    if complete.any():
        result[complete] = estimate(trace.time_s[complete], rows[:, complete])
    return result


def training_samples(trace: Trace, columns: Sequence[str], at_least: int = 1) -> Samples:
    """The samples of a trace that hold all ``columns``; raises :class:`Refused` where too few have a reference too."""
    require(trace, (*columns, REFERENCE))
    rows = np.vstack([trace.columns[name] for name in columns])
    complete = ~np.isnan(rows).any(axis=0)
    ambient = trace.reference[complete]
    known = int(np.count_nonzero(~np.isnan(ambient)))
    if known < at_least:
        problem = f"{known} samples hold {', '.join(columns)} and {REFERENCE}, the least is {at_least}"
        raise refuse(trace.path, "", problem, "log them together, and longer")
    return Samples(trace.time_s[complete], rows[:, complete], ambient)
