"""A trace from a pandas DataFrame and back: the same columns and units, and the same refusals, as the file's."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ambient_model.faults import refuse
from ambient_model.trace import LARGEST, TIME, split_column
from ambient_trainer.data.trace import Array, Trace

if TYPE_CHECKING:
    import pandas as pd  # half a second: asked for where one is at hand

SOURCE = "DataFrame"
"""What messages and provenance call a trace that came from no file."""


def trace_of(frame: pd.DataFrame, source: str = SOURCE) -> Trace:
    """Trace in a DataFrame.

    Parameters
    ----------
    frame : pandas.DataFrame
        Columns named ``<name>_<unit>``; NaN is a missing value. The time is the column ``time_s`` or the index: in s,
        or dates or durations, which count from the first row. String entries of ``frame.attrs`` become the notes.
    source : str
        What messages call it.

    Returns
    -------
    Trace
        With its own arrays.

    Raises
    ------
    Refused
        Where a name lacks a unit, time does not increase, or a value is no finite number.
    """
    names = [str(name) for name in frame.columns]
    for name in names:
        if split_column(name) == ("", ""):
            raise refuse(source, f"column {name!r}", "names no unit", "name it <name>_<unit>, such as usb_degC")
        if names.count(name) > 1:
            raise refuse(source, f"column {name!r}", "stands twice", "rename or remove one")
    if not len(frame):
        raise refuse(source, "", "no rows", "log something first")
    time_s = _numbers(source, frame.index.to_series() if TIME not in names else frame[TIME], TIME)
    late = np.flatnonzero(~(np.diff(time_s, prepend=-np.inf) > 0))
    if len(late):
        problem = f"{time_s[late[0]]:.15g} s does not come after the row before"
        raise refuse(source, f"row {late[0]}, {TIME}", problem, "sort the rows and drop doubles: time must increase")
    columns = {name: _numbers(source, frame[name], name) for name in frame.columns if name != TIME}
    notes = {key: value for key, value in frame.attrs.items() if isinstance(key, str) and isinstance(value, str)}
    return Trace(source, time_s, columns, notes)


def frame_of(trace: Trace) -> pd.DataFrame:
    """DataFrame of a trace.

    Parameters
    ----------
    trace : Trace

    Returns
    -------
    pandas.DataFrame
        One column a column of the trace, indexed by ``time_s``; the notes are its ``attrs``.
    """
    import pandas as pd

    frame = pd.DataFrame(trace.columns, index=pd.Index(trace.time_s, name=TIME))
    frame.attrs.update(trace.notes)
    return frame


def _numbers(source: str, values: pd.Series, name: str) -> Array:
    if values.dtype.kind in "mM":
        values = (values - values.iloc[0]).dt.total_seconds()
    try:
        found = values.to_numpy(dtype=np.float64, na_value=np.nan, copy=True)
    except (TypeError, ValueError) as error:
        raise refuse(source, f"column {name}", f"holds no numbers ({error})", "convert it, or leave it out") from error
    beyond = np.flatnonzero(~(np.abs(found) <= LARGEST) & ~(np.isnan(found) & (name != TIME)))
    if len(beyond):
        problem = f"{found[beyond[0]]:g} is no finite measurement"
        raise refuse(source, f"row {beyond[0]}, {name}", problem, "make it NaN for a missing value")
    return found
