"""A sensor's resolution and noise: estimated from its readings; or a resolution imposed on a finer log.

A device that rounds reads on average half a step further from 0 than one that truncates, and no reading shows which it
does. A log is made coarse half way between both, so that an estimate errs by a quarter of a step on either.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ambient_model.faults import refuse
from ambient_trainer.data.trace import Array, Trace

_STEPS = (10.0, 5.0, 2.0, 1.0, 0.5, 0.25, 0.2, 0.125, 0.1, 0.0625, 0.05, 0.03125, 0.02, 0.01, 0.005, 0.002, 0.001)
"""As converters and drivers have them: whole, halved or decimal degrees."""
_LOOKED_AT = 100_000


def resolution_of(values: Array) -> float:
    """The largest usual step that all ``values`` are multiples of; 0 where none is."""
    known = np.unique(values[~np.isnan(values)][:_LOOKED_AT])
    largest = np.abs(known).max(initial=1.0)
    fits = (step for step in _STEPS if (np.abs(known - step * np.round(known / step)) < 1e-6 * largest).all())
    return next(fits, 0.0)


def noise_of(runs: Sequence[Array]) -> float:
    """Standard deviation of the white noise of a sensor's ``runs``; 0 where none has three readings.

    Second differences of white noise have six times its variance; their median ignores what really moves.
    """
    bends = np.concatenate([np.diff(each, 2) for each in runs])
    # 1.4826: from a median absolute deviation to a standard deviation, of normal errors
    return 1.4826 * float(np.median(np.abs(bends))) / math.sqrt(6) if len(bends) else 0.0


def rounded(values: Array, step: float) -> Array:
    """``values`` to the next multiple of ``step``; as they are where it is 0."""
    return step * np.round(values / step) if step else values


def with_resolution(trace: Trace, steps: Mapping[str, float]) -> Trace:
    """``trace`` as a device logs it whose sensors (trace columns) have these steps, half way between both.

    Raises :class:`Refused` for a column that the trace lacks, and a step that is not above 0.
    """
    coarse = {}
    for name, step in steps.items():
        if not 0 < step < np.inf:
            raise refuse("--resolution", name, f"{step:g} is no step", "name one above 0, in degC")
        count = trace.column(name) / step
        coarse[name] = step * np.trunc(count + np.copysign(0.25, count))
    return replace(trace, columns={**trace.columns, **coarse})
