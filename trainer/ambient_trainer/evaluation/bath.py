"""Calibration offset of a probe: the reference's mean excess over it while both are settled in one bath.

The record of a bath is a table over ``time_s``: the reference first, then the probes, in degC, NaN where there is no
reading. Settled is a window in which neither the reference nor any probe against it drifts by more than is allowed, by
the straight line through it. The standard error of an offset counts only as many samples as are independent; the
reference's own error is not in it, as it is the same for all probes.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from ambient_model.faults import Fault, Refused, refuse
from ambient_trainer.data.probe_offsets import OffsetPoint, ProbeOffset
from ambient_trainer.data.trace import Trace, load_trace, save_trace
from ambient_trainer.estimation.uncertainty import autocorrelation_time

LARGEST_OFFSET_K = 5.0
"""Twice what the worst class of thermocouples is allowed: more is a probe that is not in the bath."""
REFERENCE = "bath"
_UNIT = "_degC"
_APART_K = 2.0  # temperatures that are nearer than this are one; between them an offset has no meaning
_PRESENT = 0.8  # of a window's samples


@dataclass(frozen=True)
class Settled:
    """What counts as settled: a window, the reference's and each probe's drift over it, and the samples in it."""

    window_s: float = 300.0
    drift_K: float = 0.05
    samples: int = 30

    def refusal(self, source: str, reasons: Sequence[str]) -> Refused:
        """Of a bath that never settled; ``reasons`` are those of its best window."""
        hint = f"in {self.window_s:g} s at most {self.drift_K:g} K are allowed: stir, insulate, wait"
        return Refused(source, [Fault("not settled", reason, hint) for reason in reasons])


def load_bath(path: str, reference: str = REFERENCE + _UNIT) -> pd.DataFrame:
    """A recorded bath: every other ``_degC`` column than the ``reference`` is a probe; raises :class:`Refused`."""
    trace = load_trace(path)
    columns = {REFERENCE: trace.column(reference)}
    probes = [name for name in trace.columns if name.endswith(_UNIT) and name != reference]
    if not probes:
        raise refuse(path, "line 1", "no probe's column beside the reference", f"name the probes' columns NAME{_UNIT}")
    columns.update((name.removesuffix(_UNIT), trace.columns[name]) for name in probes)
    return pd.DataFrame(columns, index=trace.time_s)


def save_bath(bath: pd.DataFrame, path: str) -> None:
    """Write a record as a trace, which :func:`load_bath` reads."""
    columns = {f"{name}{_UNIT}": values.to_numpy() for name, values in bath.items()}
    save_trace(path, Trace(path, bath.index.to_numpy(), columns, {"source": "calibrate"}))


def last_window(bath: pd.DataFrame, settled: Settled) -> pd.DataFrame:
    """The samples of the last window, from the last one before it on: samples may be far apart."""
    if not len(bath):
        return bath
    first = int(np.searchsorted(bath.index, bath.index[-1] - settled.window_s, side="right")) - 1
    return bath.iloc[max(first, 0) :]


def unsettled(window: pd.DataFrame, settled: Settled) -> list[str]:
    """Why a window is not settled; nothing where it is."""
    span_s = float(window.index[-1] - window.index[0]) if len(window) else 0.0
    if span_s < 0.95 * settled.window_s:
        return [f"it lasts {span_s:.0f} s of {settled.window_s:g} s"]
    reasons = []
    enough = max(settled.samples, math.ceil(_PRESENT * len(window)))
    for name in window:
        label, against, values = "the reference", "", window[name].dropna()
        if name != REFERENCE:
            label, against, values = str(name), " against the reference", (window[name] - window[REFERENCE]).dropna()
        if len(values) < enough:
            reasons.append(f"{label} has {len(values)} readings where {enough} are needed")
        elif (drift_K := abs(np.polyfit(values.index - window.index[0], values, 1)[0]) * span_s) > settled.drift_K:
            reasons.append(f"{label} drifts by {drift_K:.2f} K{against}")
    return reasons


def settled_windows(bath: pd.DataFrame, settled: Settled, source: str) -> list[pd.DataFrame]:
    """The settled windows of a record; raises :class:`Refused` where there is none, with what the best one lacks."""
    windows = [last_window(bath.iloc[: end + 1], settled) for end in range(len(bath))]
    reasons = [unsettled(window, settled) for window in windows]
    if found := [window for window, lacking in zip(windows, reasons) if not lacking]:
        return found
    raise settled.refusal(source, min(reversed(reasons), key=len))


def calibrated(windows: Sequence[pd.DataFrame], source: str) -> dict[str, ProbeOffset]:
    """The offsets by probe, from the steadiest of the settled ``windows`` of each temperature.

    The standard error of the mean of n samples with the integrated autocorrelation time tau (in samples) is
    s / sqrt(n / tau). Raises :class:`Refused` with each probe that is too far off to be in the bath ``source``.
    """
    steadiest: list[pd.DataFrame] = []
    for window in sorted(windows, key=lambda window: window[REFERENCE].std(ddof=0)):
        if all(abs(window[REFERENCE].mean() - other[REFERENCE].mean()) >= _APART_K for other in steadiest):
            steadiest.append(window)
    points: dict[str, list[OffsetPoint]] = {}
    faults = []
    for window in sorted(steadiest, key=lambda window: window[REFERENCE].mean()):
        for name in window.columns.drop(REFERENCE):
            point = _point(window[[REFERENCE, name]].dropna().to_numpy())
            points.setdefault(name, []).append(point)
            if abs(point.offset_K) > LARGEST_OFFSET_K:
                reference_degC = point.reading_degC + point.offset_K
                problem = f"reads {point.reading_degC:.2f} degC where the reference reads {reference_degC:.2f} degC"
                faults.append(Fault(name, problem, "is it in the bath, of the right type, and on this channel?"))
    if faults:
        raise Refused(source, faults)
    return {name: ProbeOffset(points=tuple(each)) for name, each in points.items()}


def _point(pairs: np.ndarray) -> OffsetPoint:
    """The offset from (reference, probe) in degC, shape (n, 2)."""
    excess_K = pairs[:, 0] - pairs[:, 1]
    independent = max(len(excess_K) / max(autocorrelation_time(excess_K), 1.0), 1.0)
    error_K = float(excess_K.std(ddof=1) / math.sqrt(independent))
    mean_degC, offset_K = float(pairs[:, 1].mean()), float(excess_K.mean())
    return OffsetPoint(reading_degC=mean_degC, offset_K=offset_K, standard_error_K=error_K)
