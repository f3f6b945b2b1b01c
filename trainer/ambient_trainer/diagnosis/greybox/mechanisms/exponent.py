"""Nonlinear loss to the ambient: G |d/d0|^p d, as in free convection (p about 0.25) or radiation."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ambient_trainer.circuits.circuit import AMBIENT
from ambient_trainer.data.trace import Array
from ambient_trainer.diagnosis.greybox.context import Context
from ambient_trainer.diagnosis.greybox.mechanisms import InProportion
from ambient_trainer.diagnosis.greybox.model import Mechanism, Number
from ambient_trainer.diagnosis.greybox.network import Network
from ambient_trainer.diagnosis.record import Record

_STEEPEST = 3.0
"""Of hot water that evaporates; a measured boiler of steam and water fell as by 2 to 5."""


@dataclass(frozen=True)
class Exponent(InProportion):
    """An exponent for each place; ``typical_degC`` is where the conductance is the circuit's own."""

    typical_degC: tuple[float, ...] = ()

    cause = "convection_law"
    noun = "a heat loss not proportional to the difference to the ambient"
    step = 0.02

    def apply(self, network: Network, values: Array, record: Record) -> None:
        self._bend(network, values, np.tile(np.array(self.typical_degC, dtype=float), (len(values), 1)))

    def _bend(self, network: Network, exponents: Array, typical_degC: Array) -> None:
        air = network.boundary(AMBIENT)
        for place, typical, exponent in zip(self.places, typical_degC.T, exponents.T):
            network.powers.append((network.index(place), air, np.array([typical, exponent])))


@dataclass(frozen=True)
class ChangedExponent(Exponent):
    """One exponent for all places, and the difference in K at which the loss is as it was."""

    assumes: float = 2.0
    """A loss changes more often than its law does, and a law holds for all that see the same air."""

    multistart = True

    def apply(self, network: Network, values: Array, record: Record) -> None:
        exponent, same_at = (np.repeat(each[:, None], len(self.places), axis=1) for each in values.T)
        self._bend(network, exponent, same_at)

    def begins(self, number: Number) -> tuple[float, float]:
        return number.low / 2, number.high / 2


def changed(context: Context) -> Iterator[Mechanism]:
    """A law that is another than it was, at each node and at all."""
    every = _unchanged(context)
    for places in context.groups(every):
        assumes = 2.0 + (len(places) < len(every))
        for typical in (0.3, 1.0, 3.0):
            size = typical * float(np.mean([context.difference_degC(each) for each in places]))
            same = Number("same_at", "K", size, log=True, low=0.1, high=200.0)
            yield ChangedExponent(places, (Number("exponent", "1", 0.0, low=-0.5, high=1.2), same), assumes=assumes)


def candidates(context: Context) -> Iterator[Mechanism]:
    """Every node that is joined to the ambient, and all of them."""
    for places in context.groups(_unchanged(context)):
        numbers = tuple(Number(f"exponent_{each}", "1", 0.0, low=-0.5, high=_STEEPEST) for each in places)
        yield Exponent(places, numbers, typical_degC=tuple(context.difference_degC(each) for each in places))


def _unchanged(context: Context) -> list[str]:
    """Nodes with a loss to the ambient of which nothing else is known: what changes it hides its law."""
    changed = {
        place for held in context.fitted.model.mechanisms if held.cause == "ambient_coupling" for place in held.places
    }
    return [each for each in context.nodes if context.loss(each) > 0 and each not in changed]
