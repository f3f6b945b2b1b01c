"""What a user calls a circuit: a shipped name, a YAML file, or ``free-N``; observers are called like circuits."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from ambient_model.faults import refuse
from ambient_trainer.circuits.circuit import Circuit
from ambient_trainer.circuits.schema import load_circuit
from ambient_trainer.data.trace import Trace
from ambient_trainer.estimation.search import Progress
from ambient_trainer.estimators.blended.fit import fit_observer, searches
from ambient_trainer.estimators.blended.recipe import find_observer, observer_names
from ambient_trainer.estimators.fit import Effort, Fit, fit_circuit, fit_free_filter, free_order
from ambient_trainer.estimators.kalman.circuit_observer import CIRCUIT_OBSERVER, fit_circuit_observer
from ambient_trainer.estimators.kalman.free_observer import FREE_OBSERVER, fit_free_observer

_FREE = "free-1 to free-4"

FitTo = Callable[[Sequence[Trace], Effort, Progress | None, float | None], Fit]

OBSERVERS = {CIRCUIT_OBSERVER: fit_circuit_observer, FREE_OBSERVER: fit_free_observer}
"""Those that read any sensors."""


@dataclass(frozen=True)
class Fitting:
    """Fits to traces with an effort, telling its progress, at a period or the traces' own."""

    run: FitTo
    searches: int | None = None
    """How many searches it is, where it is not one a start."""

    def __call__(
        self, traces: Sequence[Trace], effort: Effort, progress: Progress | None, period_s: float | None
    ) -> Fit:
        """The fit; raises :class:`Refused` where the traces do not suffice."""
        return self.run(traces, effort, progress, period_s)


def fitting(name: str, sensors: Sequence[str] = ()) -> Fitting:
    """What fits the circuit called ``name`` to traces; refuses an unknown one before any trace is read.

    ``sensors`` (trace columns) are what ``free-N`` and :data:`OBSERVERS` read; a circuit names its own.
    """
    if name in OBSERVERS:
        return Fitting(
            lambda traces, effort, progress, period_s: OBSERVERS[name](
                traces, effort, progress, period_s, sensors or None
            )
        )
    order = free_order(name)
    if order is not None:
        return Fitting(
            lambda traces, effort, progress, period_s: fit_free_filter(
                order, traces, effort, progress, period_s, sensors or None
            )
        )
    observer = find_observer(name)
    circuit = observer[1] if observer is not None else load_circuit(name, (*OBSERVERS, *observer_names(), _FREE))
    if sensors:
        own = circuit.name if observer is None else observer[0].name
        raise refuse("--sensors", "", f"{own} names its own", f"use it with {_FREE}, {' or '.join(OBSERVERS)}")
    if observer is not None:
        return Fitting(lambda *given: fit_observer(*observer, *given), searches(observer[0]))
    return Fitting(lambda *given: fit_circuit(circuit, *given))


def thermal_circuit(name: str) -> Circuit:
    """The circuit called ``name``, with nodes and parameters that mean something: filters and observers are refused."""
    if reads_any(name) or find_observer(name) is not None:
        raise refuse("--circuit", "", f"{name} has no parameters that mean anything", "name a thermal circuit")
    return load_circuit(name)


def reads_any(name: str) -> bool:
    """Whether what is called ``name`` reads whatever sensors it is given."""
    return name in OBSERVERS or free_order(name) is not None
