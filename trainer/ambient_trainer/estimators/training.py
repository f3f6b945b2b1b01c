"""What estimators are fitted to: columns and uniform grids. Traces that cannot determine a fit are refused here."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from ambient_model.faults import Fault, Refused, refuse
from ambient_model.trace import REFERENCE
from ambient_trainer.data.grid import Segment, sampling_period_s, segments
from ambient_trainer.data.trace import Trace
from ambient_trainer.estimation.structure import Structure

_NO_SENSOR = 1e9
"""No quantity of a device is as large in any of a trace's units: such a value is an error code."""
_BRIDGED_S = 120.0
"""Chosen on simulated nights with gaps: over longer ones a straight line misses more than a start in equilibrium."""


def source_of(traces: Sequence[Trace]) -> str:
    """The traces' names, for a message."""
    return ", ".join(trace.path for trace in traces)


def temperature_columns(traces: Sequence[Trace]) -> tuple[str, ...]:
    """Every ``_degC`` column of the first trace but the reference."""
    names = tuple(name for name in traces[0].columns if name.endswith("_degC") and name != REFERENCE)
    if not names:
        raise refuse(traces[0].path, "line 1", "no '_degC' column besides the reference", "log a sensor")
    return names


def slowest_period_s(traces: Sequence[Trace]) -> float:
    """The longest of the traces' sampling periods."""
    return max(sampling_period_s(trace.time_s) for trace in traces)


def training_segments(
    traces: Sequence[Trace], inputs: Sequence[str], outputs: Sequence[str], period_s: float | None, pieces: int
) -> list[Segment]:
    """The grids that a fit works on, each trace in so many pieces.

    A filter of the reference starts from equilibrium, where no device is after a short gap: so those are bridged.
    A prediction of nodes starts anywhere.
    """
    require_informative(traces, inputs, outputs)
    bridged_s = _BRIDGED_S if tuple(outputs) == (REFERENCE,) else 0.0
    whole = [segment for trace in traces for segment in segments(trace, inputs, outputs, period_s, bridged_s)]
    return [piece for segment in whole for piece in segment.pieces(pieces)]


class Training(NamedTuple):
    """What an estimator is fitted to: trace columns, the grids over them, and the traces themselves."""

    columns: tuple[str, ...]
    segments: Sequence[Segment]
    traces: Sequence[Trace]

    def without(self, dropped: int) -> Training:
        """The same without the input of that number."""
        kept = [index for index in range(len(self.columns)) if index != dropped]
        columns = tuple(self.columns[index] for index in kept)
        return Training(columns, [each.of(kept) for each in self.segments], self.traces)


def require_informative(traces: Sequence[Trace], inputs: Sequence[str], outputs: Sequence[str]) -> None:
    """Refuse traces that, taken together, hold no information on a column, naming every such column."""
    faults = [fault for name in (*inputs, *outputs) for fault in _column_faults(traces, name, inputs, outputs)]
    if faults:
        raise Refused(source_of(traces), faults)


def _column_faults(
    traces: Sequence[Trace], name: str, inputs: Sequence[str], outputs: Sequence[str]
) -> Iterator[Fault]:
    known = np.concatenate([trace.column(name) for trace in traces])
    known = known[~np.isnan(known)]
    # an estimate needs inputs that change; a simulation may have a constant boundary, but no lone constant output
    must_change = tuple(outputs) in ((REFERENCE,), (name,))
    if not len(known):
        yield Fault(f"column {name}", "holds no value at all", "leave it out, or log it")
    elif np.abs(known).max() > _NO_SENSOR:
        worst = known[np.abs(known).argmax()]
        yield Fault(f"column {name}", f"holds {worst:g}", "no sensor reads that: leave such cells empty")
    elif np.ptp(known) == 0 and must_change:
        hint = "leave out the sensor, it is stuck" if name in inputs else "log a run in which it changes"
        yield Fault(f"column {name}", f"is {known[0]:g} all the time", hint)


def require_enough(traces: Sequence[Trace], structure: Structure) -> None:
    """Refuse traces with fewer samples than ``structure`` has unknowns."""
    samples = sum(int((~np.isnan(segment.outputs)).sum()) for segment in structure.segments)
    unknowns = len(structure.search.names) + len(structure.linear.names)
    if samples <= unknowns:
        problem = f"{samples} samples for {unknowns} unknowns"
        raise refuse(source_of(traces), "", problem, "log longer, or take a smaller circuit")
