"""A journal becomes a trace: one row a period, in which each cell is what was read in that period, or empty.

A sample belongs to the period in which the middle of its asking and answering lies, and to none where that leaves its
time unknown by more than a period. Nothing is repeated or interpolated: a gap in a run is a gap in its trace.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

from ambient_model.trace import REFERENCE
from ambient_trainer.laboratory.campaign import Campaign, Laboratory
from ambient_trainer.laboratory.journal import Record
from ambient_trainer.laboratory.messages import DEVICE, MULTIPLEXER, LoadState

_ROUNDING_S = 1e-6
Cells = dict[int, dict[str, "float | None"]]


class Grid(NamedTuple):
    """Rows at multiples of ``period_s`` after ``zero_s`` of the run's time."""

    zero_s: float
    period_s: float

    def row_at(self, at_s: float) -> int:
        """The row of what happened at ``at_s``."""
        return math.floor((at_s - self.zero_s + _ROUNDING_S) / self.period_s)


class Rows(NamedTuple):
    """Columns without ``time_s``, and rows with it."""

    columns: tuple[str, ...]
    rows: list[tuple[float, list[float | None]]]


def grid_of(record: Record, campaign: Campaign) -> Grid | None:
    """The rows' times, whose zero is the beginning of the recording; None where there was none."""
    began = [each for each in record.steps if each.step >= len(campaign.before)]
    if not began:
        return None
    # on the samplers' own schedule, so that a sample which comes a little late does not change its row
    period_s = campaign.period_s
    zero_s = math.floor((began[0].at_s - began[0].elapsed_s) / period_s + _ROUNDING_S) * period_s
    return Grid(zero_s, period_s)


def trace_rows(record: Record, campaign: Campaign, grid: Grid) -> Rows:
    """The trace: the device's columns, the ambient, the signals."""
    laboratory = campaign.laboratory
    cells: Cells = {}
    for sample in record.samples:
        if 0.5 * (sample.answered_s - sample.asked_s) > grid.period_s:
            continue
        row = cells.setdefault(grid.row_at(sample.at_s), {})
        if sample.source == DEVICE:
            row.update({name: sample.values.get(name) for name in laboratory.device.columns})
        elif sample.source == MULTIPLEXER:
            row[REFERENCE] = laboratory.ambient.mean_degC(sample.values)
    over = [each.at_s for each in record.steps if each.step == len(campaign.program)]
    count = max(grid.row_at(over[-1]) if over else grid.row_at(record.left.at_s) + 1, 0)
    signals = _signals(record, laboratory, grid)
    return _rows(campaign.columns, grid, {index: {**cells.get(index, {}), **next(signals)} for index in range(count)})


def laboratory_rows(record: Record, campaign: Campaign, grid: Grid) -> Rows:
    """The instruments' own readings, also before the recording; only rows that hold any."""
    device = campaign.laboratory.device.columns
    cells: Cells = {}
    for sample in record.samples:
        row = cells.setdefault(grid.row_at(sample.at_s), {})
        row.update({name: value for name, value in sample.values.items() if name not in device})
        row[f"{sample.source}_delay_s"] = round(sample.answered_s - sample.asked_s, 4)
    return _rows(tuple(sorted({name for row in cells.values() for name in row})), grid, cells)


def _rows(columns: tuple[str, ...], grid: Grid, cells: Cells) -> Rows:
    rows = [(round(k * grid.period_s, 6), [row.get(name) for name in columns]) for k, row in sorted(cells.items())]
    return Rows(columns, rows)


def _signals(record: Record, laboratory: Laboratory, grid: Grid) -> Iterator[Mapping[str, float | None]]:
    """The signals of each row, from the first on; they are unknown until the device's load is known."""
    changes = [each for each in record.entries if isinstance(each, LoadState)]
    unknown: Mapping[str, float | None] = dict.fromkeys(laboratory.signals)
    now, index, following = unknown, 0, 0
    while True:
        while following < len(changes) and grid.row_at(changes[following].at_s) <= index:
            actions = changes[following].actions
            now = unknown if actions is None else signals_while(laboratory, actions)
            following += 1
        yield now
        index += 1


def signals_while(laboratory: Laboratory, actions: Sequence[str]) -> dict[str, float]:
    """The signals while ``actions`` last: where several have one, the largest."""
    found = dict(laboratory.signals)
    active = [laboratory.actions[action].signals for action in actions]
    for name in {signal for signals in active for signal in signals}:
        found[name] = max(signals[name] for signals in active if name in signals)
    return found
