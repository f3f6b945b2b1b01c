"""Numbers formatted for people: times like a clock, durations in a fitting unit, significant figures."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from ambient_model.trace import split_column
from ambient_trainer.report.structure import Table

if TYPE_CHECKING:
    import pandas as pd

_UNITS = {"on": "", "frac": ""}


def clock(time_s: float) -> str:
    """A time of a trace as h:mm:ss."""
    whole = math.floor(abs(time_s) + 0.5)
    sign = "-" if time_s < 0 and whole else ""
    return f"{sign}{whole // 3600}:{whole // 60 % 60:02d}:{whole % 60:02d}"


def window(onset_s: float | None, end_s: float | None) -> str:
    """When something lasted: ``from 1:00:00 to 2:30:00``; an open end is the trace's."""
    if onset_s is None and end_s is None:
        return "all the time"
    start = "from the start" if onset_s is None else f"from {clock(onset_s)}"
    return f"{start} {'to the end' if end_s is None else f'to {clock(end_s)}'}"


def duration(span_s: float, count: int = 2) -> str:
    """A span in the unit that fits it, by default to two figures: ``12 s``, ``4.5 min``, ``2.1 h``."""
    for unit_s, unit in ((3600.0, "h"), (60.0, "min")):
        if span_s >= 2 * unit_s:
            return f"{digits(span_s / unit_s, count)} {unit}"
    return f"{digits(span_s, count)} s"


def digits(value: float, count: int = 3) -> str:
    """``value`` to ``count`` significant figures, without an exponent where it can be read so."""
    if not math.isfinite(value):
        return "-"
    if value == 0:
        return "0"
    exponent = math.floor(math.log10(abs(value)))
    if not -5 <= exponent <= 6:
        return f"{value:.{count - 1}e}"
    rounded = round(value, count - 1 - exponent)
    return f"{rounded:.{max(0, count - 1 - math.floor(math.log10(abs(rounded))))}f}"


def unit_of(column: str) -> str:
    """The unit of a trace column: ``W/m2``; what is on or off, and a fraction, has none."""
    unit = split_column(column)[1]
    return _UNITS.get(unit, unit.replace("_", "/"))


def share(part: float) -> str:
    """A part of the whole in per cent: ``8 %``, ``0.4 %``."""
    return f"{100 * part:.0f} %" if part >= 0.095 or part == 0 else f"{100 * part:.1f} %"


def chance(p_value: float) -> str:
    """A probability as people read it: ``p = 0.03``, ``p < 0.001``."""
    return "p < 0.001" if p_value < 0.001 else f"p = {digits(p_value, 2)}"


def column_table(trace: pd.DataFrame) -> Table:
    """Per column of a trace: samples, gaps, and the range of what stands there."""
    lines = []
    for name, values in trace.items():
        missing, known = values.isna(), values.dropna()
        gaps = missing.groupby((missing != missing.shift()).cumsum()).sum()
        texts = [f"{each:.6g}" for each in (known.min(), known.mean(), known.max())] if len(known) else ["-"] * 3
        longest = gaps.max() if len(gaps) else 0
        lines.append((str(name), f"{len(known):,}", f"{(gaps > 0).sum():,}", f"{longest:,}", *texts))
    caption = f"Of {len(trace):,} rows. Longest: the most rows in a row without a value."
    return Table(caption, ("column", "samples", "gaps", "longest", "min", "mean", "max"), lines)
