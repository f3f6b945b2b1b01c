"""A journal becomes a trace: one row a period, in which each cell is what was said in that period, or empty.

A sample belongs to the period in which the middle of its asking and answering lies, and to none where that leaves its
time unknown by more than a period. Nothing is repeated or drawn between samples: a gap in a run is a gap in its trace.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

from ambient_model.trace import REFERENCE
from ambient_trainer.laboratory.bench import ambient_degC
from ambient_trainer.laboratory.campaign import Campaign, Laboratory
from ambient_trainer.laboratory.journal import Began, Record
from ambient_trainer.laboratory.messages import DEVICE, MULTIPLEXER, Doing, Sample

_ROUNDING_S = 1e-6
Row = tuple[float, list[float | None]]


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
    rows: list[Row]


def grid_of(record: Record, campaign: Campaign) -> Grid | None:
    """The rows' times, whose zero is the beginning of the recording; None where there was none."""
    began = [each for each in record.entries if isinstance(each, Began) and each.step >= len(campaign.before)]
    if not began:
        return None
    # on the samplers' own schedule, that a sample which comes a little late does not change its row
    period_s = campaign.period_s
    zero_s = math.floor((began[0].at_s - began[0].elapsed_s) / period_s + _ROUNDING_S) * period_s
    return Grid(zero_s, period_s)


def trace_rows(record: Record, campaign: Campaign, grid: Grid) -> Rows:
    """The trace: the device's columns, the ambient, the signals."""
    cells: dict[int, dict[str, float | None]] = {}
    for sample in _samples(record):
        if 0.5 * (sample.answered_s - sample.asked_s) > grid.period_s:
            continue
        row = cells.setdefault(grid.row_at(sample.at_s), {})
        if sample.source == DEVICE:
            row.update({name: sample.values.get(name) for name in campaign.laboratory.device.columns})
        elif sample.source == MULTIPLEXER:
            row[REFERENCE] = ambient_degC(sample.values, campaign.laboratory.ambient)
    signals = _signals(record, campaign.laboratory, grid)
    found = []
    for index in range(_end(record, campaign, grid)):
        row = {**cells.get(index, {}), **next(signals)}
        found.append((round(index * grid.period_s, 6), [row.get(name) for name in campaign.columns]))
    return Rows(campaign.columns, found)


def laboratory_rows(record: Record, campaign: Campaign, grid: Grid) -> Rows:
    """What the instruments said themselves, also before the recording; only rows in which something stands."""
    device = campaign.laboratory.device.columns
    cells: dict[int, dict[str, float | None]] = {}
    for sample in _samples(record):
        row = cells.setdefault(grid.row_at(sample.at_s), {})
        row.update({name: value for name, value in sample.values.items() if name not in device})
        row[f"{sample.source}_delay_s"] = round(sample.answered_s - sample.asked_s, 4)
    columns = tuple(sorted({name for row in cells.values() for name in row}))
    rows = [
        (round(index * grid.period_s, 6), [row.get(name) for name in columns]) for index, row in sorted(cells.items())
    ]
    return Rows(columns, rows)


def _samples(record: Record) -> Iterator[Sample]:
    return (entry for entry in record.entries if isinstance(entry, Sample))


def _end(record: Record, campaign: Campaign, grid: Grid) -> int:
    """The number of rows: to the end of the program, or to where a run was cut."""
    over = [each.at_s for each in record.entries if isinstance(each, Began) and each.step == len(campaign.program)]
    return max(grid.row_at(over[-1]) if over else grid.row_at(record.left.at_s) + 1, 0)


def _signals(record: Record, laboratory: Laboratory, grid: Grid) -> Iterator[Mapping[str, float | None]]:
    """What the signals say in each row, from the first on; nothing is known before the device was made to rest."""
    changes = [each for each in record.entries if isinstance(each, Doing)]
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
    """What the signals say while ``actions`` last: where several speak, the largest."""
    found = dict(laboratory.signals)
    for name in dict.fromkeys(signal for action in actions for signal in laboratory.actions[action].signals):
        spoken = [laboratory.actions[action].signals for action in actions]
        found[name] = max(each[name] for each in spoken if name in each)
    return found
