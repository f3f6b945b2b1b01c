"""Heat sources at nodes, proportional to a driver, or constant."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ambient_trainer.circuits.addition import with_source
from ambient_trainer.circuits.circuit import Circuit
from ambient_trainer.data.trace import Array
from ambient_trainer.diagnosis.greybox.context import HUMIDITY, PRESSURES, THERMOELECTRIC, WORK, Context
from ambient_trainer.diagnosis.greybox.expression import Expression, words_in
from ambient_trainer.diagnosis.greybox.mechanisms import InProportion
from ambient_trainer.diagnosis.greybox.model import Mechanism, Number
from ambient_trainer.diagnosis.greybox.network import Network
from ambient_trainer.diagnosis.record import Record
from ambient_trainer.report.words import share

_REFERENCE_DEGC, _GROWTH_PER_K = 25.0, 0.02
_LEAST_PER_K, _MOST_PER_K = -0.008, 0.2
"""A metal's resistance grows by 0.4 % per K, a cell's falls by several."""
_SPEED, _MOVES_AIR = "_m_s", {"fan", "fans", "blower", "wind", "gust", "vent", "damper"}
"""Of air, which heats nothing, and words in the name of what moves it: of eleven measured sets with such a column it
heated in none, and in four it went along with what did."""
_STATES = {*HUMIDITY, "moisture", "pressure"}
"""Words in the name of a state: a level of one heats nothing, though the rate of a pressure does. What hangs on a
balloon seemed to be heated by the thin air."""


@dataclass(frozen=True)
class Heat(InProportion):
    """q_i = k_i w(t): a number of each place; ``only`` where the log has nothing else that may heat."""

    only: bool = False

    cause = "heat_source"
    noun = "an unmodelled heat source"
    from_nothing = by_place = True

    @property
    def assumes(self) -> float:
        text = "" if self.driver is None else self.driver.text
        # one driver at several places is more likely at one of them, with paths to the others; thermometers that hang
        # side by side have an offset each
        several = 0.0 if self.only else float(len(self.places) - 1)
        resistive = text.endswith("_A") and THERMOELECTRIC.isdisjoint(words_in(text))
        return several + 1.0 * (not text and self.onset_s is None) + 3.0 * resistive

    @property
    def key(self) -> tuple[str, tuple[str, ...], str]:
        return self.cause, self.places, "" if self.driver is None else self.driver.form

    @property
    def tuned(self) -> bool:
        return self.driver is not None and self.driver.level is not None

    @property
    def structural(self) -> bool:
        return self.tuned

    @property
    def ambiguous(self) -> bool:
        # a heater's rate stands for heat that comes late, or for a body of its own; a flow for what it brings, or for
        # what is switched with it: a measured heat pump's compressor; work that cools for something that it goes with
        driver = self.driver
        if driver is None:
            return False
        rate, words = driver.text.startswith("d(") and driver.columns[0].endswith("_frac"), words_in(driver.columns[0])
        cools = any(number.value < 0 for number in self.numbers) and not WORK.isdisjoint(words)
        return rate or cools or "flow" in words

    def apply(self, network: Network, values: Array, record: Record) -> None:
        weight = self.weight(record)
        for place, column in zip(self.places, values.T):
            network.heat.append((network.index(place), column, weight))

    def begins(self, number: Number) -> tuple[float, float]:
        # what may only warm starts by a little where a linear fit would have it cool: the circuit may move
        return (number.low if number.low < 0 else 0.1 * number.scale), np.inf

    def native(self, circuit: Circuit) -> Circuit | None:
        driver = self.driver
        if driver is None or driver.columns != (driver.text,):
            return None
        for place, number in zip(self.places, self.numbers):
            circuit = with_source(circuit, place, driver.text, number.value, number.unit)
        return circuit

    def meaning(self, number: Number) -> str:
        return f"heat into {number.name.removeprefix('heat_')}"


@dataclass(frozen=True)
class HeatInTheCold(Heat):
    """q_i = k w(t) (1 + g (T0 - T_i)): a resistance that changes with its node's temperature."""

    def apply(self, network: Network, values: Array, record: Record) -> None:
        super().apply(network, values[:, :1], record)
        growth = (values[:, 0] * values[:, 1])[:, None, None] * self.weight(record)
        network.vary([network.index(self.places[0])], growth, np.array(_REFERENCE_DEGC))

    def probes(self) -> Sequence[Sequence[float]]:
        scale = self.numbers[0].scale
        return [[scale, 0.0], [scale, _GROWTH_PER_K]]

    def started(self, amounts: Sequence[float]) -> Mechanism | None:
        heat, growth = self.numbers
        whole = max(amounts[0] + amounts[1], 0.1)
        per_K = float(np.clip(_GROWTH_PER_K * amounts[1] / whole, growth.low / 2, growth.high / 2))
        return self.with_values([whole * heat.scale, per_K])

    def native(self, circuit: Circuit) -> Circuit | None:
        return None

    def sentence_tail(self) -> str:
        growth = self.numbers[1].value
        return f"growing {'in the cold' if growth > 0 else 'with the temperature'} by {share(abs(growth))} per K"


def windowed(context: Context) -> Iterator[Mechanism]:
    """Heat into each node, and into all, that nothing logged shows; what known-good records do not show is at one."""
    groups = context.groups(context.nodes)
    return (_heat(context, each, None) for each in groups if len(each) == 1 or not context.records[0].known_good)


def _heating(drivers: Iterable[Expression]) -> list[Expression]:
    return [each for each in drivers if not any(map(moves_air, each.columns)) and not _a_state(each)]


def moves_air(column: str) -> bool:
    """Whether a column is a speed of air, or of what moves it."""
    return column.endswith(_SPEED) or not _MOVES_AIR.isdisjoint(words_in(column))


def _a_state(driver: Expression) -> bool:
    state = driver.columns[0].endswith(PRESSURES) or not _STATES.isdisjoint(words_in(*driver.columns))
    return state and not driver.text.startswith("d(")


def candidates(context: Context) -> Iterator[Mechanism]:
    """Every node, and all that have sensors together, by every driver and by none."""
    drivers = _heating(context.drivers)
    for places in context.groups(context.nodes):
        yield replace(_heat(context, places, None), only=not drivers)
        for driver in drivers:
            yield (plain := _heat(context, places, driver))
            if driver.text.endswith("_A^2") and len(places) == 1:
                name, most = f"growth_{places[0]}", _MOST_PER_K
                growth = Number(name, "1/K", 0.0, scale=most, low=_LEAST_PER_K, high=most)
                yield HeatInTheCold(places, (*plain.numbers, growth), driver)
    # the rate of what heats a slow body is what heats a fast one
    steady = [each for each in drivers if not each.text.startswith("d(")]
    for nodes, some in ((context.nodes, _heating(context.tuned_drivers)), (context.hidden_nodes, steady)):
        yield from (_heat(context, (node,), driver) for node in nodes for driver in some)


def _heat(context: Context, places: tuple[str, ...], driver: Expression | None) -> Heat:
    size = 1.0 if driver is None else context.size(driver)
    low = 0.0 if driver is not None and context.warms(driver) else -np.inf
    unit = "W" if driver is None else driver.per("W")
    numbers = tuple(Number(f"heat_{at}", unit, 0.0, scale=context.conductance(at) / size, low=low) for at in places)
    return Heat(places, numbers, driver)
