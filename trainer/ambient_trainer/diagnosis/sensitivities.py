"""What each unknown of a model does to every sensor, the answer of all effects to it included.

An effect's heat follows the temperatures. So what an unknown does to the nodes, z, obeys

    C z' = (G + J(t)) z + q,

J being the slope of all effects' heat about the nodes as they are.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from ambient_trainer.diagnosis.circuit_parameters import changed
from ambient_trainer.diagnosis.effect_parameters import EffectParameter, moved, small_step
from ambient_trainer.diagnosis.model import Model, heat_parts, read_by_sensors, sensor_errors, with_feedback
from ambient_trainer.diagnosis.plant import Plant
from ambient_trainer.diagnosis.view import View

Array = NDArray[np.float64]

_STEP = 1e-3


def columns(model: Model, searched: Sequence[str], free: Sequence[EffectParameter], here: View) -> Array:
    """Of the searched parameters, by :func:`parameters.changed`, and of what is free of the effects, (c, s, N)."""
    moves = [_moved(model, each, here) for each in free]
    plain = [*_slopes(model, searched, here), *(nodes for nodes, _ in moves)]
    if not plain:
        return np.empty((0, *here.truth_degC.shape))
    nodes = with_feedback(model, here.record, here.model_degC, np.array(plain))
    read = read_by_sensors(model, here.record, here.truth_degC, nodes[:, here.plant.reads])
    for index, (_, errors) in enumerate(moves, start=len(searched)):
        read[index] += errors
    return read


def _slopes(model: Model, searched: Sequence[str], here: View) -> Iterator[Array]:
    """What each searched parameter does to every node, (n, N), while starts and nodes' temperatures stay."""
    if not searched:
        return
    plant = model.plant
    base = _simulated(model, here, plant)
    for name in searched:
        moved = Plant.of(plant.circuit, {**plant.values, name: changed(plant, name, _STEP)}, plant.period_s)
        yield (_simulated(model, here, moved) - base) / _STEP


def _simulated(model: Model, here: View, plant: Plant) -> Array:
    """Every node, (n, N), if the circuit were ``plant`` and the effects' heat that of the nodes as they are."""
    heat = _heat_W(model, here, plant)
    drive = plant.W @ (plant.B @ here.record.inputs + heat / plant.capacitance[:, None])
    # the start that the record was found to have
    decay = plant.modal_decay(here.record.samples)
    return np.asarray(plant.V @ (plant.modal(drive) + (plant.W @ here.start)[:, None] * decay))


def _heat_W(model: Model, here: View, plant: Plant) -> Array:
    """What all effects would give to each node of ``plant``, (n, N), its temperatures being as they are."""
    heat = np.zeros_like(here.model_degC)
    for each in heat_parts(model, plant, here.record):
        heat += each.weight * each.term.value(here.model_degC, here.ambient_degC, plant.period_s, each.onset)
    return heat


def _moved(model: Model, unknown: EffectParameter, here: View) -> tuple[Array, Array]:
    """What a step of ``unknown`` does to every node, (n, N), and to the sensors besides, (s, N), no heat answering."""
    plant, effect = here.plant, model.effects[unknown.effect]
    step = small_step(unknown, plant.period_s)
    alone = [Model(plant, (each,)) for each in (moved(effect, unknown, step), effect)]
    heat, error = (
        (one - other) / step
        for one, other in (
            [_heat_W(each, here, plant) for each in alone],
            [sensor_errors(each, here.record, here.truth_degC) for each in alone],
        )
    )
    return plant.V @ plant.modal(plant.W @ (heat / plant.capacitance[:, None])), error
