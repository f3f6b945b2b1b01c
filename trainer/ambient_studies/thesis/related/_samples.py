"""The samples that a method uses hold every column it reads; at any other it has no estimate."""

from collections.abc import Callable, Sequence
from functools import partial
from itertools import accumulate
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambient_model.faults import Fault, Refused, refuse
from ambient_model.trace import REFERENCE
from ambient_model.tracking import bridge_limit_s
from ambient_trainer.data import Array, Trace, sampling_period_s
from ambient_trainer.lti import lag_weights


class Related(NamedTuple):
    """A method: of runs of the scenarios ``trained_on``, ``train`` makes what has an ``ambient_degC`` of ``inputs``."""

    name: str
    about: str
    inputs: tuple[str, ...]
    train: Callable[..., Any]
    trained_on: tuple[str, ...] = ("5",)

    def trained(self, *traces: Trace) -> Callable[[Trace], Array]:
        """What gives the ambient in degC, shape (n,), of a trace."""
        return partial(estimated, columns=self.inputs, estimate=self.train(*traces).ambient_degC)


class Samples(NamedTuple):
    """Times in s (n,), one row a column (m, n) without gaps, the ambient in degC (n,), NaN where unknown."""

    time_s: Array
    rows: Array
    ambient_degC: Array


def estimated(trace: Trace, columns: Sequence[str], estimate: Callable[[Array, Array], Array]) -> Array:
    """``estimate(time_s, rows)`` of the samples that hold all ``columns``, NaN at the others; shape (n,)."""
    rows, complete = _complete(trace, columns)
    result = np.full(len(trace.time_s), np.nan)
    if complete.any():
        result[complete] = estimate(trace.time_s[complete], rows[:, complete])
    return result


def training_samples(trace: Trace, columns: Sequence[str], at_least: int = 1) -> Samples:
    """The samples that hold all ``columns``; raises :class:`Refused` where too few have a reference too."""
    rows, complete = _complete(trace, columns, REFERENCE)
    ambient = trace.reference[complete]
    known = int(np.count_nonzero(~np.isnan(ambient)))
    if known < at_least:
        problem = f"{known} samples hold {', '.join(columns)} and {REFERENCE}, the least is {at_least}"
        raise refuse(trace.path, "", problem, "log them together, and longer")
    return Samples(trace.time_s[complete], rows[:, complete], ambient)


def lagged(time_s: Array, values: Array, time_constant_s: float) -> Array:
    """First-order lag of samples at any times, from equilibrium with the first and after a gap too long to bridge."""
    steps_s = np.diff(time_s)
    decay, before, now = lag_weights(time_constant_s, steps_s)
    push = before * values[:-1] + now * values[1:]
    period_s = sampling_period_s(time_s)
    restarted = np.floor(steps_s / period_s + 0.5) > round(bridge_limit_s(period_s) / period_s)
    decay[restarted], push[restarted] = 0.0, values[1:][restarted]
    steps = zip(decay.tolist(), push.tolist())
    states = accumulate(steps, lambda x, step: step[0] * x + step[1], initial=float(values[0]))
    return np.fromiter(states, dtype=np.float64, count=len(values))


def _complete(trace: Trace, columns: Sequence[str], *others: str) -> tuple[Array, NDArray[np.bool_]]:
    """The rows of ``columns`` and which samples hold them all; every missing column is named in one message."""
    missing = [name for name in (*columns, *others) if name not in trace.columns]
    if missing:
        hint = f"the trace has {', '.join(trace.columns)}; log it or map it on import"
        raise Refused(trace.path, [Fault("line 1", f"no column '{name}'", hint) for name in missing])
    rows = np.vstack([trace.columns[name] for name in columns])
    return rows, np.asarray(~np.isnan(rows).any(axis=0))
