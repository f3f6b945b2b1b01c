"""Loss to the ambient that follows a driver: G_i (1 + c w(t)); with the ambient as driver, a law of convection."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ambient_trainer.circuits.circuit import AMBIENT
from ambient_trainer.data.trace import Array
from ambient_trainer.diagnosis.greybox.context import HUMIDITY, WORK, Context, is_flow
from ambient_trainer.diagnosis.greybox.expression import Expression, words_in
from ambient_trainer.diagnosis.greybox.mechanisms import InProportion
from ambient_trainer.diagnosis.greybox.mechanisms.exponent import Exponent
from ambient_trainer.diagnosis.greybox.mechanisms.heat import moves_air
from ambient_trainer.diagnosis.greybox.model import Mechanism, Number
from ambient_trainer.diagnosis.greybox.network import Network
from ambient_trainer.diagnosis.record import Record

_LEAST = 0.03
"""Of a conductance: none becomes negative."""
_MOST_LESS, _MOST_MORE, _SWEPT = 0.97, 19.0, 300.0
"""A loss goes down to next to nothing, and up to what a storm takes from still air's, or water that flows."""
_HARDLY_LESS = 0.1
"""Of the loss, where its driver does most: what heats or moves air takes none away. A loss that falls with a power
reads as heat does; by a laptop's battery, a printer's bed and a glasshouse's lamps it seemed to in measured logs."""
_AT_NIGHT = 0.05
"""Of the most: a pyranometer reads a little less than nothing at night."""
_ELECTRIC = re.compile(r"_(A|V|As|Ah|W|kW|C|ohm)\b")
"""What carries charge or heat moves no air."""
_GOES_WITH_HEAT = ("_A", "_V", "_lux")
"""Units of what is no power, and heats where it is large."""


@dataclass(frozen=True)
class Coupling(InProportion):
    """A relative change of the loss; one number for all places, or one of each."""

    cause = "ambient_coupling"
    noun = "a changed thermal resistance to the ambient"
    step = 0.02

    @property
    def assumes(self) -> float:
        return 3.0 * (self.driver is not None and bool(_ELECTRIC.search(self.driver.text)))

    @property
    def ambiguous(self) -> bool:
        words = words_in(*self.driver.columns) if self.driver else set()
        return bool(HUMIDITY & words) and "absolute" not in words

    def apply(self, network: Network, values: Array, record: Record) -> None:
        weight = self.weight(record)
        air = network.boundary(AMBIENT)
        nodes, own = _with_bodies(network, self.places, air)
        shares = values[:, own if values.shape[1] > 1 else np.zeros_like(own)]
        network.change_loss(nodes, air, np.maximum(shares[:, :, None] * weight, _LEAST - 1.0))

    def begins(self, number: Number) -> tuple[float, float]:
        return -0.5 * number.scale, 2.0 * number.scale

    @property
    def _switched(self) -> bool:
        return self.cause == "ambient_coupling" and (self.driver is None or self.driver.text.endswith("_on"))

    def stated(self, value: float) -> float:
        """What is switched by its resistance, what follows a driver by the loss."""
        return 1.0 / max(1.0 + value, _LEAST) - 1.0 if self._switched else value

    def meaning(self, number: Number) -> str:
        place = number.name.removeprefix("change_") if number.name != "change" else " and ".join(self.places)
        what = f"resistance from {place} to the ambient" if self._switched else f"loss of {place}"
        return f"relative change of the {what}"


def _with_bodies(network: Network, places: Sequence[str], air: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """The nodes of places and of the bodies behind them that see the air, and for each the number of its place."""
    pairs = [
        (index, number)
        for number, place in enumerate(places)
        for index, name in enumerate(network.nodes)
        if name == place or (name.startswith(f"{place}_mass") and bool((network.loss[:, index, air] > 0).any()))
    ]
    nodes, own = zip(*pairs)
    return np.array(nodes, dtype=np.intp), np.array(own, dtype=np.intp)


@dataclass(frozen=True)
class ZoneLoss(Coupling):
    """The loss differs between a hot and a cold ambient, in known-good records as well."""

    cause = "convection_law"
    noun = Exponent.noun
    structural = True


def windowed(context: Context) -> Iterator[Mechanism]:
    """A change of the loss of each node, and of all, that nothing logged shows."""
    joined = [each for each in context.nodes if context.loss(each) > 0]
    for places in context.groups(joined):
        change = Number("change", "1", 0.0, low=-_MOST_LESS, high=_MOST_MORE)
        yield Coupling(places, (change,))


def candidates(context: Context) -> Iterator[Mechanism]:
    """Every node that is joined to the ambient, and all of them, by every driver, and by where the ambient stands."""
    joined = [each for each in context.nodes if context.loss(each) > 0]
    for places in context.groups(joined):
        for driver in context.drivers:
            if not driver.text.startswith("d(") and "*" not in driver.text:
                yield _coupling(Coupling, context, places, driver)
                if len(places) > 1:
                    yield _coupling(Coupling, context, places, driver, shared=True)
    airy = [each for each in context.hidden_nodes if context.loss(each) > 0]
    for places in [*context.groups(joined), *(context.groups(airy) if airy else [])]:
        for driver in context.ambient_zones:
            yield _coupling(ZoneLoss, context, places, driver)


def _coupling(
    kind: type[Coupling], context: Context, places: tuple[str, ...], driver: Expression, shared: bool = False
) -> Coupling:
    scale = 1.0 / context.size(driver)
    names = ["change"] if shared else [f"change_{each}" for each in places]
    least, most = context.extent(driver)
    more = _SWEPT if is_flow(driver.columns[0]) else _MOST_MORE
    less = _HARDLY_LESS if least > -_AT_NIGHT * most and _only_raises(context, driver) else _MOST_LESS
    low = max(-less / most if most > 0 else -np.inf, more / least if least < 0 else -np.inf)
    high = min(more / most if most > 0 else np.inf, -_MOST_LESS / least if least < 0 else np.inf)
    number = Number("", driver.per("1"), 0.0, scale=scale, low=low, high=high)
    return kind(places, tuple(replace(number, name=each) for each in names), driver)


def _only_raises(context: Context, driver: Expression) -> bool:
    """Whether what a driver says heats, or moves air."""
    column = driver.columns[0]
    does = context.warms(driver) or moves_air(column) or not WORK.isdisjoint(words_in(column))
    return does or column.endswith(_GOES_WITH_HEAT)
