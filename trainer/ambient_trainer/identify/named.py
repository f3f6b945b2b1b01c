"""What a user calls a circuit: a shipped name, a YAML file, or ``free-N``."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from ambient_model.faults import refuse
from ambient_trainer.circuits.circuit import Circuit
from ambient_trainer.circuits.schema import load_circuit
from ambient_trainer.identify.fit import Effort, Fit, fit_circuit, fit_free_filter, free_order
from ambient_trainer.identify.search import Progress
from ambient_trainer.traces.trace import Trace

_FREE = "free-1 to free-4"

FitTo = Callable[[Sequence[Trace], Effort, Progress | None, float | None], Fit]


def fitting(name: str, sensors: Sequence[str] = ()) -> FitTo:
    """What fits the circuit called ``name`` to traces; refuses an unknown one before any trace is read.

    ``sensors`` (trace columns) are what ``free-N`` reads; a circuit names its own.
    """
    order = free_order(name)
    if order is not None:
        return lambda traces, effort, progress, period_s: fit_free_filter(
            order, traces, effort, progress, period_s, sensors or None
        )
    circuit = load_circuit(name, (_FREE,))
    if sensors:
        raise refuse("--sensors", "", f"{circuit.name} names its own", f"use it with {_FREE}")
    return lambda traces, effort, progress, period_s: fit_circuit(circuit, traces, effort, progress, period_s)


def thermal_circuit(name: str) -> Circuit:
    """The circuit called ``name``, with nodes and parameters that mean something: ``free-N``, too, is refused."""
    if free_order(name) is not None:
        raise refuse("--circuit", "", f"{name} has no parameters that mean anything", "name a thermal circuit")
    return load_circuit(name)
