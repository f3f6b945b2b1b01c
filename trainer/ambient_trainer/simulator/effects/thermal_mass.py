"""A node of its own that the circuit lacks: an accessory of layers, clamped on."""

import numpy as np

from ambient_trainer.simulator.additions import AIR, Added, Body, Link, apart
from ambient_trainer.simulator.hidden import Acting, Effect, Figure, Ran

_LAYERS = (0.45, 0.35, 0.2)  # shares of its capacitance, from the device outward
_LAYERED_S = 45.0  # its capacitance over the conductance to the device
_CLAMP_W_K = 0.3  # at most, that conductance
_OWN_LOSS_W_K_PER_J_K = 1e-4  # to the air


class ThermalMass(Effect):
    """A capacitance that is attached."""

    rank = 4
    unit, low, high = "J/K", 0.0, 2000.0
    meaning = "capacitance of what is attached"

    def added(self, acting: Acting, name: str) -> Added:
        """Layers in a row, each with a small loss of its own; while they are not attached they follow the air."""
        hidden, attached = acting.hidden, acting.share(20.0)
        clamp = min(hidden.amount / _LAYERED_S, _CLAMP_W_K)
        layers = [Body(f"{name} layer {k}", share * hidden.amount) for k, share in enumerate(_LAYERS)]
        names = [str(hidden.location), *(layer.name for layer in layers)]
        between = [attached * clamp, *[np.full_like(attached, 2.5 * clamp)] * (len(layers) - 1)]
        inner = [Link(one, other, flow) for one, other, flow in zip(names, names[1:], between)]
        outer = [
            Link(layer.name, AIR, apart(attached, layer.capacity_J_K) + _OWN_LOSS_W_K_PER_J_K * layer.capacity_J_K)
            for layer in layers
        ]
        return Added((), tuple(layers), (*inner, *outer))

    def magnitude(self, ran: Ran) -> Figure:
        """The capacitance, and the conductance that it is clamped on by."""
        capacity = sum(body.capacity_J_K for body in ran.added.bodies)
        clamp = ran.added.links[0].conductance_W_K[ran.there].mean() if ran.added.links else 0.0
        return capacity, "J/K", {"conductance_W_K": (float(clamp), "W/K")}


EFFECT = ThermalMass()
