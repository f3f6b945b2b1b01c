"""Latent heat: a body beside a node that stays at one temperature while it freezes or melts.

Its enthalpy, in kelvin of its own heat capacity, is the state z; the body is at z above the melting point T0, stays at
T0 while z falls by the heat of fusion L, and is at z + L below. Where it begins solid, z is counted from there.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ambient_trainer.data.trace import Array
from ambient_trainer.diagnosis.greybox.context import Context
from ambient_trainer.diagnosis.greybox.mechanisms import Joined
from ambient_trainer.diagnosis.greybox.model import Mechanism, Number, unused
from ambient_trainer.diagnosis.greybox.network import Network
from ambient_trainer.diagnosis.record import Record

_FUSION_K = 80.0
"""Water: 334 kJ/kg over 4.2 kJ/(kg K)."""
_OF_ANOTHER = 3.0
"""What a body of another matter takes for granted: in three measured sets of three nothing melted."""


@dataclass(frozen=True)
class Latent(Joined):
    """A conductance to the body, the time constant behind it, and its heat of fusion; ``melting_degC`` is given."""

    melting_degC: float = 0.0
    melts: bool = False

    cause = "latent_heat"
    noun = "a phase change, freezing or melting"
    adds_nodes = multistart = True
    least = 0.3

    @property
    def ambiguous(self) -> bool:
        # water is everywhere; whatever else dwells may have come to rest
        return self.melting_degC != 0.0

    @property
    def assumes(self) -> float:
        return _OF_ANOTHER * self.ambiguous

    def apply(self, network: Network, values: Array, record: Record) -> None:
        node = network.index(self.places[0])
        conductance, lag, fusion = values.T
        melting_degC, sign = np.full_like(fusion, self.melting_degC), np.full_like(fusion, -1.0 if self.melts else 1.0)
        body = network.add_node(unused(network, f"{self.places[0]}_phase"), conductance * lag)
        network.join(node, body, conductance)
        network.phases.append((node, body, np.array([conductance, fusion, melting_degC, sign])))


def candidates(context: Context) -> Iterator[Mechanism]:
    """Every node whose readings dwell at one temperature."""
    for node in context.nodes:
        for plateau in context.plateaus_degC(node):
            for lag in np.geomspace(10 * context.period_s, context.longest_s / 10, 3):
                conductance = Number(f"G_{node}_phase", "W/K", context.conductance(node), log=True)
                behind = Number(f"lag_{node}_phase", "s", float(lag), log=True, low=2 * context.period_s)
                fusion = Number(f"fusion_{node}", "K", _FUSION_K, log=True, low=1.0, high=1e4)
                melts = context.first_degC(node) < plateau
                yield Latent((node,), (conductance, behind, fusion), melting_degC=plateau, melts=melts)
