"""Records of a trace for the diagnosis: a uniform grid with every logged column averaged over each interval.

Means keep the heat of short bursts, and lower noise. But straight lines between means of an air that jumps are another
air: a circuit is simulated in the log's own samples, and compared by means over several of these steps. Where a change
against known-good records is asked for, both are simulated on the grid itself: what that gets wrong, both have.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from ambient_model.tracking import bridge_limit_s
from ambient_trainer.circuits.circuit import Circuit
from ambient_trainer.data.grid import sampling_period_s, segments
from ambient_trainer.data.trace import Array, Trace
from ambient_trainer.lti.statespace import Hold

MOST_SAMPLES, MOST_STEPS = 2000, 10_000
"""Of readings, and of the simulation."""
_FEWEST = 3
_NICE = (1.0, 2.0, 5.0)


@dataclass(frozen=True)
class Record:
    """One gapless stretch of a trace, N samples every ``period_s``.

    ``inputs`` (m, N) are the circuit's, without gaps; ``sensors`` (s, N) the temperatures it predicts, NaN where
    missing; ``signals`` holds every other logged column and the ambient, by name, each (N,), without gaps.
    """

    period_s: float
    time_s: Array
    inputs: Array
    sensors: Array
    signals: Mapping[str, Array]
    weight: Array | None = None
    """Of each sensor's readings (s,), by what is known of its noise; None: all alike."""
    fine: Record | None = None
    """The same stretch as it is simulated, with several steps to each sample; None: with one."""

    @property
    def simulated(self) -> Record:
        """What a simulation runs on."""
        return self if self.fine is None else self.fine

    @property
    def every(self) -> int:
        """Steps of the simulation to each sample."""
        return self.simulated.samples // self.samples

    @property
    def known_good(self) -> bool:
        """Whether it is held against known-good records, which show how each sensor's readings wander."""
        return self.weight is not None

    @property
    def weights(self) -> Array:
        """As a column (s, 1)."""
        return np.ones((len(self.sensors), 1)) if self.weight is None else self.weight[:, None]

    @property
    def samples(self) -> int:
        """N."""
        return len(self.time_s)

    @cached_property
    def valid(self) -> NDArray[np.intp]:
        """Where readings are, among all of them sensor by sensor, (M,)."""
        return np.flatnonzero(np.isfinite(self.sensors))

    def weighted(self, degC: Array) -> Array:
        """Of temperatures (P, s, N) those where readings are, times their weights, (P, M)."""
        row = degC.reshape(len(degC), -1)[:, self.valid]
        return row if self.weight is None else row * self.weight.repeat(self.samples)[self.valid]


def diagnosis_period_s(traces: Sequence[Trace]) -> float:
    """The finest period, the traces' own or a multiple of it, that leaves at most ``MOST_SAMPLES`` of the longest."""
    own = max(sampling_period_s(trace.time_s) for trace in traces)
    # samples, not seconds: a gap of a day takes no time to simulate
    wanted = max(_logged_s(trace) / MOST_SAMPLES / own for trace in traces)
    factors = (base * 10.0**power for power in range(9) for base in _NICE)
    return own * next(factor for factor in factors if factor >= wanted)


def _logged_s(trace: Trace) -> float:
    period = sampling_period_s(trace.time_s)
    return float(np.minimum(np.diff(trace.time_s), 10 * period).sum()) if len(trace.time_s) > 1 else 0.0


def records(
    trace: Trace, inputs: Sequence[str], sensors: Sequence[str], period_s: float, hold: Hold = "first-order"
) -> list[Record]:
    """The stretches of ``trace`` with all ``inputs``, and any sensor; raises :class:`Refused` where there is none."""
    return _on_grid(straight(trace, sensors, hold), inputs, sensors, period_s)


def records_of(circuit: Circuit, trace: Trace, period_s: float) -> list[Record]:
    """The records of a trace, with the inputs and sensors of a forward circuit."""
    return records(trace, circuit.inputs, [each.column for each in circuit.outputs], period_s, circuit.hold)


def finely_simulated(circuit: Circuit, trace: Trace, period_s: float) -> list[Record]:
    """As :func:`records_of`, but simulated in the log's own samples, or in as few of them as ``MOST_STEPS`` allows."""
    every, sensors = _every(trace, period_s), [each.column for each in circuit.outputs]
    held = straight(trace, sensors, circuit.hold)
    fine = _on_grid(held, circuit.inputs, sensors, period_s / every, bridge_limit_s(period_s))
    long_enough = [_averaged(each, every) for each in fine if each.samples >= _FEWEST * every]
    return long_enough or records_of(circuit, trace, period_s)


def _every(trace: Trace, period_s: float) -> int:
    """How many steps a sample is simulated in: to whole samples of the log, and at most ``MOST_STEPS`` in all."""
    logged = period_s / sampling_period_s(trace.time_s)
    most = MOST_STEPS * period_s / max(_logged_s(trace), period_s)
    if abs(logged - round(logged)) > 1e-6 * logged:
        return 1
    return max(each for each in range(1, round(logged) + 1) if round(logged) % each == 0 and each <= max(most, 1))


def _on_grid(
    trace: Trace, inputs: Sequence[str], sensors: Sequence[str], period_s: float, bridged_s: float = 0.0
) -> list[Record]:
    extra = [name for name in trace.columns if name not in sensors]
    mean = means(trace, period_s)
    timed = replace(mean, columns={**mean.columns, _TIME: mean.time_s})
    stretches = [
        Record(
            period_s,
            segment.outputs[0, 0] + period_s * np.arange(segment.inputs.shape[1]),
            segment.inputs,
            segment.outputs[1 : 1 + len(sensors)],
            {name: bridged(row) for name, row in zip(extra, segment.outputs[1 + len(sensors) :])},
        )
        for segment in segments(timed, inputs, [_TIME, *sensors, *extra], period_s, bridged_s)
    ]
    return [each for each in stretches if np.isfinite(each.sensors).any()] or stretches


def _averaged(fine: Record, every: int) -> Record:
    """A sample to ``every`` steps of a record, as many as are whole."""
    if every == 1:
        return fine
    whole = slice(fine.samples // every * every)
    time_s, inputs, sensors = (row[..., whole] for row in (fine.time_s, fine.inputs, fine.sensors))
    signals = {name: row[whole] for name, row in fine.signals.items()}
    known = np.isfinite(sensors)
    read, share = averaged(np.where(known, sensors, 0.0), every), averaged(known.astype(float), every)
    read = np.where(share > 0, read / np.where(share > 0, share, 1.0), np.nan)
    coarse = {name: averaged(row, every) for name, row in signals.items()}
    cut = replace(fine, time_s=time_s, inputs=inputs, sensors=sensors, signals=signals)
    return Record(fine.period_s * every, averaged(time_s, every), averaged(inputs, every), read, coarse, fine=cut)


def averaged(rows: Array, every: int) -> Array:
    """The means (..., N) of ``rows`` (..., N * every) over each ``every`` of them."""
    return np.asarray(rows.reshape(*rows.shape[:-1], -1, every) @ np.ones(every) / every)


_TIME = "grid time"


def straight(trace: Trace, sensors: Sequence[str], hold: Hold) -> Trace:
    """``trace`` as if its values were joined by straight lines, whatever the ``hold`` of all columns but ``sensors``.

    A value that lasts until the next acts half a sample later: what it makes of the time around a sample is the mean of
    it and the one before.
    """
    if hold == "first-order":
        return trace
    columns = dict(trace.columns)
    for name in columns.keys() - set(sensors):
        row = columns[name]
        before = np.concatenate([row[:1], row[:-1]])
        columns[name] = np.where(np.isnan(before), row, (before + row) / 2)
    return replace(trace, columns=columns)


def means(trace: Trace, period_s: float) -> Trace:
    """The trace with one sample a period: the mean of the values that lie in it, NaN where none does."""
    if period_s <= 1.5 * sampling_period_s(trace.time_s):
        return trace
    position = np.floor((trace.time_s - trace.time_s[0]) / period_s).astype(int)
    mean = pd.DataFrame(trace.columns).groupby(position).mean()
    columns = {name: mean[name].to_numpy() for name in trace.columns}
    return replace(trace, time_s=trace.time_s[0] + (mean.index.to_numpy() + 0.5) * period_s, columns=columns)


def bridged(row: Array) -> Array:
    """``row`` (N,) with straight lines over its gaps; zero where nothing is known."""
    return pd.Series(row).interpolate(limit_direction="both").fillna(0.0).to_numpy(copy=True)
