"""A conduction path that the circuit lacks: a strap with a mass of its own."""

from itertools import permutations

import numpy as np

from ambient_trainer.simulator.additions import AIR, Added, Body, Link, apart
from ambient_trainer.simulator.device import Device
from ambient_trainer.simulator.hidden import Acting, Effect, Figure, Ran

_STRAP_S = 12.0  # a strap's capacitance over its conductance
_LEAST_STRAP_J_K = 1.0


class Path(Effect):
    """A conductance between two nodes."""

    rank = 5
    unit, low, high = "W/K", 0.0, 0.5
    meaning = "conductance of the strap"

    def places(self, device: Device) -> tuple[str, ...]:
        return tuple("-".join(pair) for pair in permutations(device.nodes, 2))

    def added(self, acting: Acting, name: str) -> Added:
        """Two halves with the strap's mass between them."""
        hidden, clamped = acting.hidden, acting.share(30.0)
        strap = Body(f"{name} strap", max(_STRAP_S * hidden.amount, _LEAST_STRAP_J_K))
        halves = [Link(strap.name, end, 2.0 * hidden.amount * clamped) for end in str(hidden.location).split("-")]
        return Added((), (strap,), (*halves, Link(strap.name, AIR, apart(clamped, strap.capacity_J_K))))

    def magnitude(self, ran: Ran) -> Figure:
        """The halves in series."""
        halves = [link.conductance_W_K[ran.there] for link in ran.added.links if link.other != AIR]
        series = 1.0 / (1.0 / halves[0] + 1.0 / halves[1]) if halves else np.zeros(1)
        return float(series.mean()), "W/K", {}


EFFECT = Path()
