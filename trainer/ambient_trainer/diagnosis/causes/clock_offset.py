"""The reference's clock and the device's disagree by a constant."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ambient_trainer.diagnosis.candidate import DELTA_95, Candidate, CauseKind, Estimate, Setting, Span
from ambient_trainer.diagnosis.result import Cause, Magnitude
from ambient_trainer.diagnosis.terms import HeatTerm
from ambient_trainer.diagnosis.view import View, conductances_to_ambient

Array = NDArray[np.float64]

_NAME = "clock_offset"
_LARGEST_S = 1800.0
_SHAPES = 6


def _candidates(setting: Setting) -> Iterator[Candidate]:
    """The reference read some time later or earlier; positive where it is logged too late."""
    if not conductances_to_ambient(setting.plant).any():
        return
    sizes = np.geomspace(setting.plant.period_s, max(_LARGEST_S, 4 * setting.plant.period_s), _SHAPES)
    for offset_s in (*-sizes[::-1], *sizes):
        yield _shifted(setting, float(offset_s))


def _shifted(setting: Setting, offset_s: float) -> Candidate:
    conductance = conductances_to_ambient(setting.plant)

    def law(nodes_degC: Array, ambient_degC: Array) -> Array:
        return np.multiply.outer(conductance, np.ones_like(ambient_degC))

    def terms(view: View) -> tuple[HeatTerm, ...]:
        time_s, air = view.record.time_s, view.ambient_degC
        return (HeatTerm(np.interp(time_s + offset_s, time_s, air) - air, law),)

    def magnitude(estimate: Estimate) -> Magnitude:
        half = DELTA_95 * abs(offset_s) * estimate.deviation(1)
        meaning = "how much later the reference is logged than it was"
        return Magnitude(offset_s, "s", meaning, (offset_s - half, offset_s + half))

    return Candidate(
        Cause(_NAME),
        Span.WHOLE,
        terms,
        magnitude,
        fixed=(1.0,),
        shape=offset_s,
        reshaped=lambda shape: _shifted(setting, shape),
    )


KIND = CauseKind(
    _NAME,
    "a clock offset between the reference and the device",
    "the reference's clock is off",
    _candidates,
    lambda cause: "it is the clock, not the heat: shift the reference in the trace",
    rank=80,
    shifts_clock=True,
)
