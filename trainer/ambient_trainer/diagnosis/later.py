"""Simulation error of the bare and the extended circuit on time that no step of a diagnosis has used.

Both are simulated forward from the beginning of the trace and run on, without a reading, through the time that is
scored: their start is fitted to what lies before it. The extended circuit is the one in its file.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ambient_model.faults import Refused, refuse
from ambient_trainer.circuits.circuit import Circuit
from ambient_trainer.circuits.schema import parse_circuit
from ambient_trainer.circuits.write import write_circuit
from ambient_trainer.data.grid import sampling_period_s
from ambient_trainer.data.trace import Array, Trace
from ambient_trainer.diagnosis.forward import forward
from ambient_trainer.diagnosis.greybox.file import greybox_of
from ambient_trainer.diagnosis.greybox.regression import fitted_start, simulate
from ambient_trainer.diagnosis.record import records_of


@dataclass(frozen=True)
class Later:
    """Forward simulation error over all sensors from ``from_s`` on, of ``samples`` grid points.

    Without a circuit that holds what was found, ``extended_rmse_degC`` is that of the bare one.
    """

    from_s: float
    bare_rmse_degC: float
    extended_rmse_degC: float
    samples: int


def later_errors(bare: Circuit, extended: Circuit | None, traces: Sequence[Trace], from_s: float) -> Later:
    """Errors of two circuits, as their parameters' initial values have them, on the later part of traces; raises
    :class:`Refused` where no sensor is read there."""
    before = _residual_degC(bare, traces, from_s)
    scored = np.isfinite(before)
    if not scored.any():
        raise _nothing_later(traces, from_s)
    read_again = extended and parse_circuit(write_circuit(extended), extended.name)
    after = before if read_again is None else _residual_degC(read_again, traces, from_s)
    bare_degC, extended_degC = (float(np.sqrt(np.nanmean(each**2))) for each in (before, after))
    return Later(from_s, bare_degC, extended_degC, int(scored.any(axis=0).sum()))


def require_later(traces: Sequence[Trace], from_s: float) -> None:
    """Refuse traces of which none goes on to ``from_s``, before anything is computed."""
    if all(trace.time_s[-1] < from_s for trace in traces):
        raise _nothing_later(traces, from_s)


def _nothing_later(traces: Sequence[Trace], from_s: float) -> Refused:
    problem = f"no sensor is read from {from_s:.10g} s on"
    return refuse("--later", ", ".join(trace.path for trace in traces), problem, "choose an earlier time")


def _residual_degC(circuit: Circuit, traces: Sequence[Trace], from_s: float) -> Array:
    """Measured less simulated from ``from_s`` on, (s, samples), NaN where nothing was measured; the start is fitted to
    the samples before."""
    plain = forward(circuit)
    model, left = greybox_of(plain), []
    for record in (each for trace in traces for each in records_of(plain, trace, sampling_period_s(trace.time_s))):
        later = record.time_s >= from_s
        known = record if later.all() else replace(record, sensors=np.where(later, np.nan, record.sensors))
        read = simulate(model, record, model.z()[None], fitted_start(model, known)[None])[0]
        left.append((record.sensors - read)[:, later])
    return np.concatenate(left, axis=1)
