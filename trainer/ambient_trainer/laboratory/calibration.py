"""A probe's offset is the reference's mean excess over it while both were settled in the same bath.

The record of a bath is a table over ``time_s``: the reference first, then the probes, in degC, NaN where there is no
reading. Settled is a window in which neither the reference nor any probe against it drifts by more than is allowed, by
the straight line through it. The standard error of an offset counts only as many samples as are independent; the
reference's own error is not in it, as it is the same for all probes.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from ambient_model.faults import Fault, Refused, refuse
from ambient_trainer.data.trace import Trace, load_trace, save_trace
from ambient_trainer.estimation.uncertainty import residual_memory
from ambient_trainer.laboratory.instruments import (
    THERMOMETER_COLUMN,
    Driver,
    MultiplexerSettings,
    ThermometerSettings,
    instrument,
    probe_column,
)
from ambient_trainer.laboratory.messages import Clock, InstrumentError
from ambient_trainer.laboratory.probe_offsets import OffsetPoint, ProbeOffset
from ambient_trainer.report import Block, Finding, Report, Table
from ambient_trainer.simulator.chamber import Chamber
from ambient_trainer.simulator.chamber_air import ChamberAir

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
        against = "" if name == REFERENCE else " against the reference"
        values = (window[name] if name == REFERENCE else window[name] - window[REFERENCE]).dropna()
        label = "the reference" if name == REFERENCE else name
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
    points: dict[str, list[OffsetPoint]] = {}
    faults = []
    for window in sorted(_by_temperature(windows), key=lambda window: window[REFERENCE].mean()):
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


def _by_temperature(windows: Sequence[pd.DataFrame]) -> list[pd.DataFrame]:
    """For each temperature its steadiest window."""
    kept: list[pd.DataFrame] = []
    for window in sorted(windows, key=lambda window: window[REFERENCE].std(ddof=0)):
        if all(abs(window[REFERENCE].mean() - other[REFERENCE].mean()) >= _APART_K for other in kept):
            kept.append(window)
    return kept


def _point(pairs: np.ndarray) -> OffsetPoint:
    """The offset from (reference, probe) in degC, shape (n, 2)."""
    excess_K = pairs[:, 0] - pairs[:, 1]
    independent = max(len(excess_K) / max(residual_memory(excess_K), 1.0), 1.0)
    return OffsetPoint(
        reading_degC=float(pairs[:, 1].mean()),
        offset_K=float(excess_K.mean()),
        standard_error_K=float(excess_K.std(ddof=1) / math.sqrt(independent)),
    )


BATHS_DEGC = (0.0, 20.0, 40.0, 60.0)
"""The temperatures to which the simulated bath goes, one after the other."""
SPEED = 100.0
_BATH = Chamber(heating_K_min=1e4, cooling_K_min=1e4, wobble_degC=0.0, settling_s=120.0, draught_degC=0.0)  # chosen


class BathInstruments(NamedTuple):
    """The reference and the probes in one bath; ``go_to`` brings it to its temperature 0, 1, 2 and so on.

    ``errors_K`` is what the probes read too much, where that is known.
    """

    thermometer: Driver
    multiplexer: Driver
    probes: tuple[str, ...]
    clock: Clock
    go_to: Callable[[int], None]
    errors_K: Mapping[str, float] | None = None

    def identify(self) -> str:
        """The reference by its number; raises :class:`InstrumentError` where either instrument does not answer."""
        self.multiplexer.read()
        return self.thermometer.identify()


@contextlib.contextmanager
def _each(what: str, links: Sequence[Any], *arguments: object) -> Iterator[list[Any]]:
    """A ``Driver``, or what is ``Simulated``, of each instrument, closed in the end."""
    with contextlib.ExitStack() as stack:
        kinds = [getattr(instrument(link.kind), what) for link in links]
        yield [stack.enter_context(closing(kind(link, *arguments))) for kind, link in zip(kinds, links)]


@contextlib.contextmanager
def real_bath(
    thermometer: ThermometerSettings, multiplexer: MultiplexerSettings, go_to: Callable[[int], None]
) -> Iterator[BathInstruments]:
    """Two instruments at their ports."""
    clock = Clock()
    with _each("Driver", (thermometer, multiplexer), clock) as drivers:
        yield BathInstruments(drivers[0], drivers[1], tuple(multiplexer.probes), clock, go_to)


@contextlib.contextmanager
def simulated_bath(
    thermometer: ThermometerSettings, multiplexer: MultiplexerSettings, speed: float = SPEED, room_degC: float = 22.0
) -> Iterator[BathInstruments]:
    """The same instruments simulated, ``speed`` times as fast; their bath goes to :data:`BATHS_DEGC`."""
    clock = Clock(speed)
    bath, links = ChamberAir(clock.now_s(), room_degC, 0, _BATH), (thermometer, multiplexer)
    with _each("Simulated", links, clock, bath.at) as there:
        ports = [link.model_copy(update={"port": each.port}) for link, each in zip(links, there)]
        go_to = lambda point: bath.drive(clock.now_s(), BATHS_DEGC[point])  # noqa: E731
        with _each("Driver", ports, clock) as drivers:
            probes, errors_K = tuple(multiplexer.probes), there[1].errors_K
            yield BathInstruments(drivers[0], drivers[1], probes, clock, go_to, errors_K)


class BathRecorder:
    """Reads the instruments every ``period_s``, and keeps all readings of one run; a bath has ``patience_s``."""

    def __init__(self, instruments: BathInstruments, period_s: float, patience_s: float) -> None:
        self._instruments, self._period_s, self._patience_s = instruments, period_s, patience_s
        self._clock, self._began_s = instruments.clock, instruments.clock.now_s()
        self._rows: dict[float, dict[str, float | None]] = {}

    def record(self) -> pd.DataFrame:
        """What was read so far."""
        columns = {THERMOMETER_COLUMN: REFERENCE, **{probe_column(name): name for name in self._instruments.probes}}
        table = pd.DataFrame.from_dict(self._rows, orient="index", columns=list(columns), dtype=float)
        return table.rename(columns=columns)

    def windows(
        self, count: int, settled: Settled, show: Callable[[str], None], record_path: str | None
    ) -> list[pd.DataFrame]:
        """The settled window of each of ``count`` temperatures; all readings go to ``record_path``, also of a failure.

        ``show`` gets a line at each sample; for errors see :meth:`until_settled`.
        """
        found: list[pd.DataFrame] = []
        try:
            for point in range(count):
                self._instruments.go_to(point)
                head = f"bath {point + 1} of {count}"
                found.append(self.until_settled(settled, lambda text, head=head: show(f"{head}, {text}")))  # type: ignore[misc]
        finally:
            if record_path is not None:
                save_bath(self.record(), record_path)
        return found

    def until_settled(self, settled: Settled, show: Callable[[str], None]) -> pd.DataFrame:
        """The window in which the bath is settled; ``show`` gets its temperature at each sample, and what it lacks.

        Raises :class:`~ambient_model.faults.Refused` where patience ends, and an instrument's
        :class:`InstrumentError` where it did not answer in a whole window.
        """
        first, began_s = len(self._rows), self._clock.now_s()
        due_s = answered_s = began_s
        while True:
            failure = self._sample()
            window = last_window(self.record().iloc[first:], settled)
            reasons = unsettled(window, settled)
            lacking = "; ".join([str(failure), *reasons] if failure else reasons) or "settled"
            show(f"{window[REFERENCE].iloc[-1]:.2f} degC: {lacking}")
            if not reasons:
                return window
            now_s = self._clock.now_s()
            if failure is None:
                answered_s = now_s
            elif now_s - answered_s > settled.window_s:
                raise failure
            if now_s - began_s > self._patience_s:
                raise settled.refusal("the bath", reasons)
            due_s = max(due_s + self._period_s, self._clock.now_s())
            self._clock.sleep(due_s - self._clock.now_s())

    def _sample(self) -> InstrumentError | None:
        """Read both; a failure is a missing value, and returned."""
        failure = None
        values: dict[str, float | None] = {}
        at_s = self._clock.now_s() - self._began_s
        for each in (self._instruments.thermometer, self._instruments.multiplexer):
            try:
                values.update(each.read().values)
            except InstrumentError as error:
                failure = error
        self._rows[at_s] = values
        return failure


def report_of(
    offsets: Mapping[str, ProbeOffset], path: str, reference: str, errors_K: Mapping[str, float] | None = None
) -> Report:
    """The offsets in the file at ``path``; ``errors_K`` is what the probes read too much, where that is known."""
    points = [(name, point) for name, offset in offsets.items() for point in offset.points]
    rows = [
        (name, f"{point.reading_degC:.2f}", f"{point.offset_K:+.4f}", f"{point.standard_error_K:.4f}")
        for name, point in points
    ]
    note = f"Offsets in K, added to what a probe reads. Reference: {reference}; its own error is not in them."
    blocks: list[Block] = [Table("", ("probe", "reads degC", "offset", "standard error"), rows), Finding(note)]
    if errors_K is not None:
        worst_K = max(abs(point.offset_K + errors_K[name]) for name, point in points)
        text = f"The simulated probes' errors are known: the worst offset misses its by {worst_K:.4f} K."
        blocks.append(Finding(text))
    return Report(f"Offsets: {path}", blocks, [], {}, "Calibration")
