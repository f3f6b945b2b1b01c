"""Names become estimators: each module in ``library`` is asked for its own; any other name is a circuit's.

An entry point in the group ``ambient_trainer.estimators.library`` counts like a module there.
"""

from __future__ import annotations

from collections.abc import Sequence

from ambient_model.faults import refuse
from ambient_trainer.circuits.circuit import Circuit
from ambient_trainer.circuits.schema import load_circuit
from ambient_trainer.data.plugins import plugin, plugin_names
from ambient_trainer.estimators.base import Estimator
from ambient_trainer.estimators.circuit import CircuitEstimator

LIBRARY = "ambient_trainer.estimators.library"


def estimator_names() -> tuple[str, ...]:
    """The names of all estimators but the circuits'."""
    return tuple(name for each in plugin_names(LIBRARY) for name in plugin(LIBRARY, each).NAMES)


def estimator(name: str, sensors: Sequence[str] = ()) -> Estimator:
    """The estimator called ``name``, or of the circuit or recipe in that YAML file.

    ``sensors`` are the trace columns that it shall read. Raises :class:`Refused` for an unknown name, a file with
    faults, and sensors of an estimator that names its own.
    """
    found = _find(name) or CircuitEstimator(load_circuit(name, estimator_names()))
    if sensors and not found.reads_any:
        reading_any = [each for each in estimator_names() if getattr(_find(each), "reads_any", False)]
        raise refuse("--sensors", "", f"{found.name} names its own", f"use it with {', '.join(reading_any)}")
    return found


def thermal_circuit(name: str) -> Circuit:
    """The circuit called ``name``, whose nodes and parameters have a meaning; estimators without one are refused."""
    if _find(name) is not None:
        raise refuse("--circuit", "", f"{name} has no parameters with a meaning", "name a thermal circuit")
    return load_circuit(name)


def _find(name: str) -> Estimator | None:
    found = (plugin(LIBRARY, each).find(name) for each in plugin_names(LIBRARY))
    return next((each for each in found if each is not None), None)
