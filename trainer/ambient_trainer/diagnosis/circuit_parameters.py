"""How a circuit's parameters move: resistances and capacitances in their logarithm, shares by as much of themselves."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ambient_trainer.diagnosis.plant import Plant

_LONGEST = 0.7
_LEAST_SHARE = 0.1


def changed(plant: Plant, name: str, step: float) -> float:
    """A parameter moved by ``step``."""
    value = plant.values[name]
    # the step of a parameter that the data do not determine has no bound of its own
    step = min(max(step, -_LONGEST), _LONGEST)
    return value + step * _share_unit(value) if _is_share(plant, name) else value * float(np.exp(step))


def traded(plant: Plant, name: str, step: float) -> float:
    """As :func:`changed` where the step is short; of a long one, conductances and capacitances are straight lines.

    Kirchhoff's law is linear in both: what trades one path for another then leaves all temperatures as they were.
    """
    value = plant.values[name]
    step = min(max(step, -_LONGEST), _LONGEST)
    if _is_share(plant, name):
        return value + step * _share_unit(value)
    resists = any(edge.resistance == name for edge in plant.circuit.edges)
    return value / (1.0 - step) if resists else value * (1.0 + step)


Change = Callable[[Plant, str, float], float]


def bounded(plant: Plant, name: str, step: float, change: Change = changed) -> float:
    """A parameter changed by ``step``, within its bounds."""
    limits = next(each for each in plant.circuit.parameters if each.name == name)
    return float(np.clip(change(plant, name, step), limits.low, limits.high))


def moved_to(plant: Plant, name: str, value: float) -> float:
    """The step by which a parameter becomes ``value``."""
    now = plant.values[name]
    return (value - now) / _share_unit(now) if _is_share(plant, name) else float(np.log(value / now))


def moved_by(plant: Plant, other: Plant, name: str) -> tuple[float, float]:
    """By which step the parameter of ``plant`` became that of ``other``, and how much a step from there adds to it."""
    value, now = plant.values[name], other.values[name]
    return moved_to(plant, name, now), _share_unit(now) / _share_unit(value) if _is_share(plant, name) else 1.0


def _is_share(plant: Plant, name: str) -> bool:
    return any(source.share == name for source in plant.circuit.sources)


def _share_unit(value: float) -> float:
    return max(abs(value), _LEAST_SHARE)
