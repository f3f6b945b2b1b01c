"""Traces come as paths, DataFrames or traces, one or several; a frame is known by the SHA-256 of its content."""

import hashlib
import os
from collections.abc import Sequence
from dataclasses import replace
from typing import TypeAlias

import numpy as np
import pandas as pd

from ambient_trainer.data import trace as trace_file
from ambient_trainer.data.trace import Trace, sha256_of

One: TypeAlias = "str | os.PathLike[str] | pd.DataFrame | Trace"
Data: TypeAlias = "One | Sequence[One]"

_PATH, _FILE_SHA256, _CONTENT_SHA256 = "trace_path", "trace_sha256", "content_sha256"


def load_trace(path: str | os.PathLike[str]) -> pd.DataFrame:
    """Trace file as a DataFrame.

    Parameters
    ----------
    path : str or path
        A CSV file whose first column is ``time_s`` and whose others are named ``<name>_<unit>``; ``.gz`` is read, too.

    Returns
    -------
    pandas.DataFrame
        One column a signal, indexed by ``time_s``; a missing value is NaN. As long as its values stay as they are, a
        model that is fitted to it names the file in its provenance.

    Raises
    ------
    Refused
        Names line and column of anything that is not allowed.

    Examples
    --------
    >>> import ambient_trainer as at
    >>> at.simulate("2.1", period_s=60.0).save("run.csv")
    'run.csv'
    >>> at.load_trace("run.csv").index.name
    'time_s'
    """
    trace = trace_file.load_trace(os.fspath(path))
    frame = trace.to_frame()
    marks = {_PATH: trace.path, _FILE_SHA256: sha256_of(trace.path), _CONTENT_SHA256: _content_sha256(trace)}
    frame.attrs.update(marks)
    return frame


def traces_of(data: Data) -> list[Trace]:
    """The traces in ``data``; raises :class:`Refused` for a file or a frame that is none."""
    if isinstance(data, str | os.PathLike | pd.DataFrame | Trace):
        return [_trace(data)]
    return [_trace(each) for each in data]


def sensor_columns(names: Sequence[str] | None) -> tuple[str, ...]:
    """The trace columns of temperature sensors, named with or without their unit; a text names several, as ``a,b``."""
    if isinstance(names, str):
        names = [name.strip() for name in names.split(",") if name.strip()]
    return tuple(name if name.endswith("_degC") else f"{name}_degC" for name in names or ())


def _trace(data: One) -> Trace:
    if isinstance(data, Trace):
        return data
    trace = trace_file.load_trace(data)
    if not isinstance(data, pd.DataFrame):
        return trace
    content = _content_sha256(trace)
    if data.attrs.get(_CONTENT_SHA256) == content:
        return replace(trace, path=data.attrs[_PATH], sha256=data.attrs[_FILE_SHA256])
    return replace(trace, sha256=content)


def _content_sha256(trace: Trace) -> str:
    digest = hashlib.sha256(np.ascontiguousarray(trace.time_s).tobytes())
    for name, values in trace.columns.items():
        digest.update(name.encode())
        digest.update(np.ascontiguousarray(values).tobytes())
    return digest.hexdigest()
