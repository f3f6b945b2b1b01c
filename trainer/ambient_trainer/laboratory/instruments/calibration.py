"""A probe's offset is what the reference read more, on average, while both were settled in the same bath.

Settled is a stretch over which neither the reference nor any probe against it drifts by more than is allowed, by the
straight line through it. The standard error of an offset counts only as many samples as are independent; the
reference's own error is not in it, as it is the same for all probes.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ambient_model.faults import Fault, Refused
from ambient_trainer.estimation.uncertainty import residual_memory
from ambient_trainer.laboratory.instruments.offsets import ProbePoint, ProbeTable

Array = NDArray[np.float64]

LARGEST_OFFSET_K = 5.0
"""Twice what the worst class of thermocouples is allowed: more is a probe that is not in the bath."""
_APART_K = 2.0  # temperatures that are nearer than this are one; between them an offset says nothing
_PRESENT = 0.8  # of a window's samples


@dataclass(frozen=True)
class Settled:
    """What counts as settled."""

    window_s: float = 300.0
    drift_K: float = 0.05
    """Over the window; the reference's, and each probe's against it."""
    samples: int = 30


@dataclass(frozen=True)
class Bath:
    """What reference and probes read, in degC, NaN where they did not; arrays of shape (n,)."""

    time_s: Array
    reference_degC: Array
    probes_degC: Mapping[str, Array]

    def part(self, begin: int, end: int) -> Bath:
        """The samples from ``begin`` to before ``end``."""
        probes = {name: values[begin:end] for name, values in self.probes_degC.items()}
        return Bath(self.time_s[begin:end], self.reference_degC[begin:end], probes)

    def last(self, duration_s: float) -> Bath:
        """The samples of the last ``duration_s``."""
        begin = int(np.searchsorted(self.time_s, self.time_s[-1] - duration_s)) if len(self.time_s) else 0
        return self.part(begin, len(self.time_s))


def unsettled(bath: Bath, settled: Settled) -> list[str]:
    """Why ``bath``, a window, is not settled; nothing where it is."""
    span_s = float(bath.time_s[-1] - bath.time_s[0]) if len(bath.time_s) else 0.0
    if span_s < 0.95 * settled.window_s:
        return [f"it lasts {span_s:.0f} s of {settled.window_s:g} s"]
    reasons = []
    signals = {"the reference": bath.reference_degC}
    signals.update({name: values - bath.reference_degC for name, values in bath.probes_degC.items()})
    for name, values in signals.items():
        there = np.isfinite(values)
        enough = max(settled.samples, math.ceil(_PRESENT * len(values)))
        if there.sum() < enough:
            reasons.append(f"{name} has {there.sum()} readings where {enough} are needed")
            continue
        drift_K = abs(_slope(bath.time_s[there], values[there])) * span_s
        if drift_K > settled.drift_K:
            against = "" if name == "the reference" else " against the reference"
            reasons.append(f"{name} drifts by {drift_K:.2f} K{against}")
    return reasons


def _slope(time_s: Array, values: Array) -> float:
    """Of the straight line through ``values`` by least squares, per second."""
    since_s = time_s - time_s.mean()
    return float(since_s @ (values - values.mean()) / (since_s @ since_s))


def settled_windows(bath: Bath, settled: Settled, source: str) -> list[Bath]:
    """The settled windows of a record; raises :class:`Refused` where there is none, with what the best one lacks."""
    windows = [bath.part(0, end).last(settled.window_s) for end in range(1, len(bath.time_s) + 1)]
    faults = [unsettled(window, settled) for window in windows]
    found = [window for window, reasons in zip(windows, faults) if not reasons]
    if not found:
        raise not_settled(source, min(reversed(faults), key=len), settled)
    return found


def not_settled(source: str, reasons: Sequence[str], settled: Settled) -> Refused:
    """The refusal of a bath that never settled; ``reasons`` are those of its best window."""
    mend = f"in {settled.window_s:g} s at most {settled.drift_K:g} K are allowed: stir, insulate, wait"
    return Refused(source, [Fault("not settled", reason, mend) for reason in reasons])


def calibrated(windows: Sequence[Bath], source: str) -> dict[str, ProbeTable]:
    """The offsets from settled windows, one point per temperature; raises :class:`Refused` for those that cannot be."""
    points: dict[str, list[ProbePoint]] = {}
    faults = []
    for window in _by_temperature(windows):
        for name, values_degC in window.probes_degC.items():
            point = _point(window.reference_degC, values_degC)
            points.setdefault(name, []).append(point)
            if abs(point.offset_K) > LARGEST_OFFSET_K:
                faults.append(
                    Fault(
                        name,
                        f"reads {point.reading_degC:.2f} degC where the reference reads "
                        f"{point.reading_degC + point.offset_K:.2f} degC",
                        "is it in the bath, of the right type, and on this channel?",
                    )
                )
    if faults:
        raise Refused(source, faults)
    return {
        name: ProbeTable(points=tuple(sorted(each, key=lambda point: point.reading_degC)))
        for name, each in points.items()
    }


def _by_temperature(windows: Sequence[Bath]) -> list[Bath]:
    """For each temperature its steadiest window."""
    kept: list[Bath] = []
    for window in sorted(windows, key=_restlessness):
        level_degC = float(np.nanmean(window.reference_degC))
        if all(abs(level_degC - np.nanmean(other.reference_degC)) >= _APART_K for other in kept):
            kept.append(window)
    return kept


def _restlessness(window: Bath) -> float:
    return float(np.nanstd(window.reference_degC))


def _point(reference_degC: Array, probe_degC: Array) -> ProbePoint:
    both = np.isfinite(reference_degC) & np.isfinite(probe_degC)
    more_K = reference_degC[both] - probe_degC[both]
    independent = len(more_K) / max(residual_memory(more_K), 1.0)
    return ProbePoint(
        reading_degC=float(probe_degC[both].mean()),
        offset_K=float(more_K.mean()),
        standard_error_K=float(more_K.std(ddof=1) / math.sqrt(max(independent, 1.0))),
    )
