"""Estimates the ambient temperature of a device from its own sensors: fit, evaluate, diagnose and simulate.

``import ambient_trainer as at`` is cheap: numpy and scipy are imported when a function is first used.

Examples
--------
>>> import ambient_trainer as at
>>> log = at.simulate("3", period_s=10.0).trace
>>> result = at.fit(log, "linear_usb", to_s=3_000)
>>> result.model.main.inputs[0].column
'usb_degC'
>>> scores = at.evaluate(result, log, from_s=3_000)
>>> scores.metrics.index.names
FrozenList(['trace', 'method'])
"""

import importlib
from typing import TYPE_CHECKING, Any

from ambient_model import __version__

if TYPE_CHECKING:
    from ambient_model.codec import load_model
    from ambient_model.faults import Refused
    from ambient_trainer.api.data import load_trace
    from ambient_trainer.api.diagnosing import DiagnosisResult, diagnose
    from ambient_trainer.api.evaluating import EvaluationResult, evaluate
    from ambient_trainer.api.fitting import FitResult, fit
    from ambient_trainer.api.fleet import FleetResult, fit_fleet
    from ambient_trainer.api.simulating import SimulationResult, simulate
    from ambient_trainer.estimators.base import Effort

__all__ = [
    "DiagnosisResult",
    "Effort",
    "EvaluationResult",
    "FitResult",
    "FleetResult",
    "Refused",
    "SimulationResult",
    "__version__",
    "diagnose",
    "evaluate",
    "fit",
    "fit_fleet",
    "load_model",
    "load_trace",
    "simulate",
]

_PLACES = {
    "ambient_model.codec": ["load_model"],
    "ambient_model.faults": ["Refused"],
    "ambient_trainer.api.data": ["load_trace"],
    "ambient_trainer.api.diagnosing": ["DiagnosisResult", "diagnose"],
    "ambient_trainer.api.evaluating": ["EvaluationResult", "evaluate"],
    "ambient_trainer.api.fitting": ["FitResult", "fit"],
    "ambient_trainer.api.fleet": ["FleetResult", "fit_fleet"],
    "ambient_trainer.api.simulating": ["SimulationResult", "simulate"],
    "ambient_trainer.estimators.base": ["Effort"],
}


def __getattr__(name: str) -> Any:
    """What stands under ``name``, imported when it is asked for (PEP 562)."""
    for module, names in _PLACES.items():
        if name in names:
            return getattr(importlib.import_module(module), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
