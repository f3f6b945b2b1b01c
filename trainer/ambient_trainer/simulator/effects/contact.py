"""A body of its own temperature holds on: a hand with blood, cloth before a thigh, a table on a cold slab."""

import numpy as np

from ambient_trainer.lti.lag import lagged
from ambient_trainer.simulator.additions import AIR, Added, Body, Link
from ambient_trainer.simulator.chamber import coloured
from ambient_trainer.simulator.hidden import Acting, Effect, Figure, Ran

# by body: what touches and its J/K, what keeps its temperature and within which degC, and W/K from the first to the
# second and to the air; chosen
_BODIES = {
    "hand": ("skin", 45.0, "blood", (35.0, 37.0), 3.0, 0.08),
    "pocket": ("cloth", 25.0, "thigh", (32.0, 34.5), 1.8, 0.12),
    "table": ("top", 300.0, "slab", (8.0, 14.0), 4.0, 0.3),
}


class Contact(Effect):
    """A conductance between body and device."""

    rank = 2
    unit, low, high = "W/K", 0.0, 2.0
    meaning = "conductance between body and device"
    typical = 0.07
    bodies = tuple(_BODIES)
    at, everywhere = "surfaces", True

    def added(self, acting: Acting, name: str) -> Added:
        """A grip that varies, shared by area."""
        hidden, random = acting.hidden, acting.random()
        count, period_s = len(acting.time_s), acting.period_s
        grip = 1.0 + 0.15 * lagged(coloured(count, period_s, 120.0, random), 15.0, period_s)
        conductance = hidden.amount * acting.share() * np.clip(grip, 0.3, 1.7)
        near, capacity_J_K, far, degC, inner_W_K, outer_W_K = _BODIES[hidden.body or "hand"]
        touching = Body(f"{name} {near}", capacity_J_K)
        core = Body(f"{name} {far}", np.inf, random.uniform(*degC))
        areas = {node: acting.device.nodes[node].surface_m2 for node in acting.covered}
        held = [Link(touching.name, node, area / sum(areas.values()) * conductance) for node, area in areas.items()]
        steady = np.ones(count)
        within = Link(touching.name, core.name, inner_W_K * steady), Link(touching.name, AIR, outer_W_K * steady)
        return Added((), (touching, core), (*held, *within))

    def magnitude(self, ran: Ran) -> Figure:
        """Mean temperature of what touches; the straight line of its heat flow over the touched surfaces' mean."""
        nodes = tuple(ran.device.nodes)
        touching = [link for link in ran.added.links if link.other in nodes]
        if not touching:
            return 0.0, "degC", {}
        index = [body.name for body in ran.all_added.bodies].index(touching[0].one)
        body = ran.driven.bodies_degC[:, index][ran.there]
        conductances = np.array([link.conductance_W_K[ran.there] for link in touching])
        nodes_degC = np.array([ran.driven.nodes_degC[ran.there][:, nodes.index(link.other)] for link in touching])
        flow = (conductances * (body - nodes_degC)).sum(axis=0)
        total = conductances.sum(axis=0)
        held = ran.share()[ran.there] > 1.0 - 1e-9
        touched = (conductances * nodes_degC).sum(axis=0)[held] / total[held]
        design = np.column_stack([np.ones_like(touched), -touched])
        (offset, conductance), *_ = np.linalg.lstsq(design, flow[held], rcond=None)
        others = {
            "conductance_W_K": (float(total.mean()), "W/K"),
            "equivalent_W_K": (float(conductance), "W/K"),
            "equivalent_degC": (float(offset / conductance) if conductance else 0.0, "degC"),
        }
        return float(body.mean()), "degC", others


EFFECT = Contact()
