"""Hidden thermal mass behind a node, optionally with a loss to the ambient."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ambient_trainer.circuits.addition import with_body, with_edge
from ambient_trainer.circuits.circuit import AMBIENT, Circuit
from ambient_trainer.data.trace import Array
from ambient_trainer.diagnosis.greybox.context import Context
from ambient_trainer.diagnosis.greybox.model import Mechanism, Number, unused
from ambient_trainer.diagnosis.greybox.network import Network
from ambient_trainer.diagnosis.record import Record

_PROBE = 1e-3
_LAGS = 6
_AIRED_S = 300.0
"""Time constant of a body that hangs in the air."""
_SLOWEST, _STAYS, _HARDLY_MOVES = 30.0, 0.9, 0.1
"""Times the record: beyond that a body is a boundary; and from which shares of that on it is priced as one, and hardly
sure: of sixteen in measured logs that were surer than 0.65 half stood for constant heat or offsets."""


@dataclass(frozen=True)
class HiddenMass(Mechanism):
    """Per place a conductance, a time constant behind it, and with ``sees_ambient`` a conductance to the air."""

    sees_ambient: bool = False

    cause = "thermal_mass"
    noun = "an unmodelled thermal mass"
    adds_nodes = multistart = True

    @property
    def structural(self) -> bool:
        return self.permanent or self.sees_ambient or len(self.places) > 1

    @property
    def assumes(self) -> float:
        # a temperature that stays is as much taken for granted as heat that does, at each place
        return float(len(self.places) * self._slower(_STAYS))

    @property
    def ambiguous(self) -> bool:
        return self._slower(_HARDLY_MOVES)

    def _slower(self, share: float) -> bool:
        """Whether one of the bodies has more than a share of the longest time constant."""
        lags = self.numbers[1 :: 2 + self.sees_ambient]
        return self.permanent and any(each.value > share * each.high for each in lags)

    @property
    def _values(self) -> Array:
        """Its numbers, by place (p, 2 or 3)."""
        return np.array([each.value for each in self.numbers]).reshape(len(self.places), 2 + self.sees_ambient)

    def apply(self, network: Network, values: Array, record: Record) -> None:
        weight = None if self.permanent else self.weight(record)
        by_place = values.T.reshape(len(self.places), 2 + self.sees_ambient, -1)
        for place, (conductance, lag, *to_air) in zip(self.places, by_place):
            body = unused(network, f"{place}_mass")
            mass = network.add_node(body, conductance * lag)
            network.link(body, place, conductance, weight)
            if weight is not None and AMBIENT in network.boundaries:
                # before it holds on and after it follows the air
                network.link(body, AMBIENT, conductance * lag / _AIRED_S, 1.0 - weight)
            for each in to_air:
                network.link(body, AMBIENT, each)
                network.loss[:, mass, network.boundary(AMBIENT)] += each

    def probes(self) -> Sequence[Sequence[float]]:
        count = len(self.places)
        probes, own = np.tile(self._values, (count, 1, 1)), np.eye(count, dtype=bool)
        probes[own, 0::2] *= _PROBE
        # the others are as good as absent
        probes[~own, 0] *= 1e-6 * _PROBE
        return probes.reshape(count, -1).tolist()

    def started(self, amounts: Sequence[float]) -> Mechanism | None:
        values = self._values
        # to first order a second mass may seem to take heat from the first: it starts small, and the fit decides
        values[:, 0::2] *= np.clip(_PROBE * np.array(amounts), 0.1, 3.0)[:, None]
        return self.with_values(values.ravel().tolist())

    def native(self, circuit: Circuit) -> Circuit | None:
        for place, (conductance, lag, *to_air) in zip(self.places, self._values.tolist()):
            circuit = with_body(circuit, place, conductance * lag, 1.0 / conductance)
            for each in to_air:
                circuit = with_edge(circuit, circuit.nodes[-1].name, AMBIENT, 1.0 / each)
        return circuit

    @property
    def slow(self) -> bool:
        # one that is put there for a while has a bound of its own
        lag = self.numbers[1]
        return self.permanent and bool(lag.value > lag.high / _SLOWEST)

    def sentence_tail(self) -> str:
        return "slower than the record: a constant temperature has the same effect" * self.slow

    def product(self) -> tuple[str, str, tuple[int, int]] | None:
        if self.slow:
            return None
        return f"heat capacity of the mass behind {self.places[0]}", "J/K", (0, 1)

    def meaning(self, number: Number) -> str:
        place = number.name.removeprefix("G_").removesuffix("_mass")
        return f"conductance between {place} and the mass behind {place}"


def candidates(context: Context) -> Iterator[Mechanism]:
    """Behind every node, and behind all, with time constants from a few samples to half the record."""
    lags = np.geomspace(3 * context.period_s, context.longest_s / 6, _LAGS)
    for places in (*context.groups(context.nodes), *((each,) for each in context.hidden_nodes)):
        for lag in lags:
            yield _mass(context, places, float(lag), sees_ambient=False)
            if places[0] in context.nodes and all(context.loss(each) > 0 for each in places):
                yield _mass(context, places, float(lag), sees_ambient=True)


def begun(context: Context) -> Iterator[Mechanism]:
    """A body that is put to a node, and may be taken away; one that is slower than the record is a loss."""
    for node in context.nodes:
        for lag in np.geomspace(10 * context.period_s, context.longest_s / 12, 3):
            mass = _mass(context, (node,), float(lag), sees_ambient=False)
            conductance, behind = mass.numbers
            yield replace(mass, numbers=(conductance, replace(behind, high=context.longest_s / 3, saturates=False)))


def _mass(context: Context, places: tuple[str, ...], lag_s: float, sees_ambient: bool) -> HiddenMass:
    numbers: list[Number] = []
    for each in places:
        conductance = context.conductance(each)
        joined = Number(f"G_{each}_mass", "W/K", conductance, log=True)
        low, high = context.period_s / 3, _SLOWEST * context.longest_s
        lag = Number(f"lag_{each}_mass", "s", lag_s, True, low=low, high=high, saturates=True)
        airy = Number(f"G_{each}_mass_ambient", "W/K", conductance / 2, log=True)
        numbers += [joined, lag, airy][: 2 + sees_ambient]
    return HiddenMass(places, tuple(numbers), sees_ambient=sees_ambient)
