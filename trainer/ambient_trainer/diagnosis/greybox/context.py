"""Context from which candidates are generated: the fitted model, its places, and the drivers in the log."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.signal import correlate, find_peaks

from ambient_model.trace import FLOW_UNITS, REFERENCE
from ambient_trainer.circuits.circuit import AMBIENT
from ambient_trainer.data.trace import Array
from ambient_trainer.diagnosis.greybox.expression import LATE, Expression, words_in
from ambient_trainer.diagnosis.greybox.model import samples_of
from ambient_trainer.diagnosis.greybox.network import Network
from ambient_trainer.diagnosis.greybox.regression import Fitted
from ambient_trainer.diagnosis.record import Record

_VARIES, _PULSE = 0.1, 3
"""Of a column's greatest value; and samples in a row in which one that rests else is away from there."""
_STILL_DEGC, _MOVED_DEGC, _STILL_SAMPLES = 0.15, 1.0, 30
COARSE = 6
"""Levels; of readings that move, and take fewer, a step may be one of their resolution, and rest too."""
_DWELLS, _WATER = 0.3, 0.1
_MOST_COLUMNS = 24
_NEAR_REST, _RESTS = 0.05, 0.2
"""Of a column's range, and of the samples that are so near to where it rests."""
_AGAIN = 0.5
"""Of an autocorrelation: how far a peak of it stands out where a column repeats itself."""
_LEVELS, _SHORTEST_DELAY, _LONGEST_DELAY, _LONGEST_DELAY_S = 10, 6.0, 0.08, 3600.0
"""Samples, of the record, and what a pipe or a duct may take: a day's cycle delayed by hours is a mass."""
LIGHT = ("_W_m2", "_kW_m2", "_lux")
WARMING = ("_W", "_kW", "_W_m2", "_kW_m2")
THERMOELECTRIC = {"peltier", "tec"}
_COOLERS = {"aircon", "chiller", "compressor", "cooler", "cooling", "freezer", "fridge", "hvac", *THERMOELECTRIC}
"""Words in the name of what takes heat away by the power that it uses, or, a Peltier element, by its current."""
HEATERS = {"heater", "burner", "boiler", "lamp"}
WORK = {*HEATERS, "load", "cpu", "gpu", "usage", "duty", "pwm"}
"""Words in the names of heaters, and of work that heats, in whatever unit."""
HUMIDITY = {"humidity", "rh"}
"""Words in the name of a relative humidity, which falls where the air is warmed: an effect as well as a cause."""
PRESSURES = ("_hPa", "_Pa", "_bar")
"""What is compressed warms by its rate; of others only the rate of a share that heats a slow body heats a fast one."""
_SQUARED = ("_A", "_m_s", "_rpm", "_rad_s")
_ANGLES = ("_deg",)
_FLOWS = ("_Hz", "_lpm", "_gpm", *(f"_{each}" for each in FLOW_UNITS))
"""A turbine meter gives pulses."""
_CHARGES, _SHARES = ("_As", "_Ah", "_frac"), ("_frac", "_on")
_OF_A_CURRENT = (*_CHARGES, "_V")
"""What a resistance may depend on, and what shades or switches any other heat: no other products make physics."""


@dataclass(frozen=True)
class Context:
    """The model as it is fitted, and ``nodes_degC`` (n, N) of every record."""

    fitted: Fitted

    @property
    def records(self) -> Sequence[Record]:
        """The records that are diagnosed."""
        return self.fitted.records

    @property
    def period_s(self) -> float:
        """Sampling period of the grid."""
        return self.records[0].period_s

    @property
    def duration_s(self) -> float:
        """Total duration of the records."""
        return sum(record.samples for record in self.records) * self.period_s

    @property
    def longest_s(self) -> float:
        """Duration of the longest record."""
        return max(record.samples for record in self.records) * self.period_s

    @cached_property
    def network(self) -> Network:
        """Network of the first record, one lane."""
        return self.fitted.model.network(self.records[0], self.fitted.model.z()[None])

    @property
    def nodes(self) -> list[str]:
        """The circuit's own nodes."""
        return [node.name for node in self.fitted.model.circuit.states]

    @property
    def sensors(self) -> tuple[str, ...]:
        """Names of the sensors."""
        return self.network.sensors

    def groups(self, places: Sequence[str]) -> list[tuple[str, ...]]:
        """Each place alone, and all places together."""
        alone: list[tuple[str, ...]] = [(each,) for each in places]
        return [*alone, tuple(places)] if len(places) > 1 else alone

    def conductance(self, node: str) -> float:
        """Sum of the conductances at a node, in W/K."""
        index = self.network.index(node)
        return float(self.network.between[0, index].sum() + self.network.to_boundary[0, index].sum())

    def loss(self, node: str) -> float:
        """The circuit's own conductance from a node to the ambient, in W/K."""
        if AMBIENT not in self.network.boundaries:
            return 0.0
        return float(self.network.loss[0, self.network.index(node), self.network.boundary(AMBIENT)])

    def joined(self, one: str, other: str) -> bool:
        """Whether two places have a path already."""
        net = self.network
        if other in net.nodes:
            return bool(net.between[0, net.index(one), net.index(other)] > 0)
        return other in net.boundaries and bool(net.to_boundary[0, net.index(one), net.boundary(other)] > 0)

    @property
    def other_temperatures(self) -> list[str]:
        """Logged temperatures that are neither a sensor of the circuit nor the reference."""
        known = {f"{each}_degC" for each in self.sensors} | {REFERENCE} | set(self.fitted.model.circuit.inputs)
        return [name.removesuffix("_degC") for name in self._logged if name.endswith("_degC") and name not in known]

    @cached_property
    def _logged(self) -> dict[str, Array]:
        """The columns that all records have, one record after the other."""
        names = [each for each in self.records[0].signals if all(each in record.signals for record in self.records)]
        return {name: np.concatenate([record.signals[name] for record in self.records]) for name in names}

    @cached_property
    def columns(self) -> list[str]:
        """Logged columns of all records that vary; a power, or light, may be nearly constant."""
        return [name for name, row in self._logged.items() if _varies(row) or (name.endswith(WARMING) and row.all())]

    @cached_property
    def drivers(self) -> list[Expression]:
        """Simplest first: columns, squares of currents, voltages, speeds, rates, then products with known drivers."""
        plain = [each for each in self.columns if not each.endswith(("_degC", *_ANGLES))][:_MOST_COLUMNS]
        found = [*plain, *(f"{each}^2" for each in plain if each.endswith((*_SQUARED, "_V")))]
        metered = [each for each in plain if not each.endswith((*WARMING, *_SQUARED, *_CHARGES, *_SHARES, *PRESSURES))]
        found += [f"{each} - {rest:.4g}" for each in metered if (rest := _rest(self._logged[each])) is not None]
        heats = [each for each in self.known_heat if each.endswith("_frac")]
        found += [f"d({each})/dt" for each in plain if each.endswith(PRESSURES) or each in heats]
        for driver in self.known_heat:
            states = _OF_A_CURRENT if "_A" in driver else _SHARES
            found += [f"{driver}*{other}" for other in plain if other.endswith(states) and other not in driver]
            if "_A" in driver:
                found += [f"{driver}*{other}^2" for other in plain if other.endswith(_CHARGES)]
        return self._usable(found)

    @cached_property
    def tuned_drivers(self) -> list[Expression]:
        """Columns with a delay, as of a pipe, or a lag, as of a heater's own body; columns above a threshold, except
        powers, currents and work."""
        plain = [each.text for each in self.drivers if each.columns == (each.text,)]
        shortest_s, longest_s = _SHORTEST_DELAY * self.period_s, min(_LONGEST_DELAY * self.longest_s, _LONGEST_DELAY_S)
        delays_s = np.geomspace(shortest_s, longest_s, 8) if shortest_s < longest_s else np.zeros(0)
        found = []
        for each in plain:
            sooner_s = delays_s[delays_s < self.repeats_s(each)]
            found += [f"{late}({each}, {delay_s:.4g})" for late in LATE for delay_s in sooner_s]
        for each in plain:
            row = self._logged[each]
            works = each.endswith((*WARMING, "_A")) or not WORK.isdisjoint(words_in(each))
            if not works and len(np.unique(row)) > _LEVELS:
                found += [f"{each} > {level:.3g}" for level in np.quantile(row, (0.2, 0.4, 0.6, 0.8))]
        return self._usable(found)

    def repeats_s(self, name: str) -> float:
        """Half the period of a column by its autocorrelation, infinite if it is not periodic: with a longer delay one
        cycle is mistaken for another."""
        row = max((record.signals[name] for record in self.records), key=len)
        row = row - row.mean()
        alike = correlate(row, row, method="fft")[len(row) - 1 :] / max(float(row @ row), 1e-300)
        peaks, _ = find_peaks(alike, prominence=_AGAIN)
        return self.period_s * float(peaks[0]) / 2 if len(peaks) else np.inf

    @property
    def flows(self) -> list[Expression]:
        """Logged flows, which carry a fluid whose temperature may be logged."""
        return [each for each in self.drivers if each.columns == (each.text,) and is_flow(each.text)]

    @cached_property
    def known_heat(self) -> list[str]:
        """Simple drivers of heat that the model has."""
        heating = [each.driver for each in self.fitted.model.mechanisms if each.cause == "heat_source" and each.driver]
        return [text for text in dict.fromkeys(each.text for each in heating) if "*" not in text]

    @cached_property
    def hidden_nodes(self) -> list[str]:
        """Nodes added by permanent mechanisms, except those of a phase change."""
        melting = {self.network.nodes[body] for _, body, _ in self.network.phases}
        added = self.network.nodes[len(self.nodes) :]
        return [each for each in added if self.conductance(each) > 0 and each not in melting]

    @cached_property
    def ambient_varies(self) -> bool:
        """Whether the reference moves by more than a degree."""
        return any(np.ptp(record.signals[REFERENCE]) > 1.0 for record in self.records if REFERENCE in record.signals)

    def _usable(self, texts: Sequence[str]) -> list[Expression]:
        """Those expressions that are finite and vary."""
        rows = [(each, self._row(each)) for each in map(Expression, dict.fromkeys(texts))]
        finite = [(each, row) for each, row in rows if np.isfinite(row).all()]
        return [each for each, row in finite if np.std(row) > 1e-9 * max(np.abs(row).max(), 1e-300)]

    def _row(self, driver: Expression) -> Array:
        return np.concatenate([driver.value(samples_of(record)) for record in self.records])

    def size(self, driver: Expression) -> float:
        """Root mean square of a driver."""
        return float(np.sqrt(np.mean(self._row(driver) ** 2)))

    def extent(self, driver: Expression) -> tuple[float, float]:
        """Minimum and maximum of a driver."""
        row = self._row(driver)
        return float(row.min()), float(row.max())

    def warms(self, driver: Expression) -> bool:
        """Whether it can only heat: heaters, powers, light and squared currents, except those of a cooler."""
        text = driver.columns[0] if driver.level is not None else driver.text
        words = words_in(*driver.columns)
        # an ac conditions the air; an ac1 is one of several phases of an alternating current
        cools = not _COOLERS.isdisjoint(words) or "ac" in driver.columns[0].split("_")
        if cools or "*" in text or text.startswith("d("):
            return False
        return text.endswith((*WARMING, *LIGHT, "_A^2", "_V^2")) or not HEATERS.isdisjoint(words)

    def has_a_heater(self, node: str, beside: Expression | None) -> bool:
        """Whether a logged heater, or work, other than what ``beside`` is by, is named after a node."""
        words, known = set(node.lower().split("_")), () if beside is None else beside.columns
        others = (each for each in self.columns if each not in known and not each.endswith("_degC"))
        # by its number, too: another room's heater is none of this one's
        named = (each for each in others if words <= set(each.lower().split("_")))
        return any(not WORK.isdisjoint(words_in(each) - words_in(node)) for each in named)

    @cached_property
    def ambient_zones(self) -> list[Expression]:
        """Thresholds of the ambient that divide the records: at a quarter, half and three quarters of its range."""
        air = np.concatenate([record.signals.get(REFERENCE, np.zeros(record.samples)) for record in self.records])
        if np.ptp(air) < 5.0:
            return []
        low, high = np.quantile(air, [0.05, 0.95])
        levels = np.unique(np.round([low + share * (high - low) for share in (0.25, 0.5, 0.75)]))
        return [Expression(f"{REFERENCE} > {level:g}") for level in levels if level < air.max()]

    def difference_degC(self, node: str) -> float:
        """Root mean square difference of a node to the ambient."""
        index, apart = self.nodes.index(node), []
        for record, run in zip(self.records, self.fitted.runs):
            network = self.fitted.model.network(record, self.fitted.model.z()[None])
            nodes = network.nodes_degC(run.start[None])[0]
            apart.append(nodes[index] - network.boundary_degC[network.boundary(AMBIENT)])
        return float(max(np.sqrt(np.mean(np.concatenate(apart) ** 2)), 0.1))

    def mean_degC(self, sensor: str) -> float:
        """Mean of a sensor's readings."""
        index = self.sensors.index(sensor)
        return float(np.nanmean(np.concatenate([record.sensors[index] for record in self.records])))

    def still(self, sensor: str) -> tuple[float, float | None, float | None] | None:
        """Reading of a stuck sensor, whose simulation varies, and its onset and end; None if it is never stuck."""
        longest = max(range(len(self.records)), key=lambda each: self.records[each].samples)
        record, number = self.records[longest], self.sensors.index(sensor)
        known = np.flatnonzero(np.isfinite(record.sensors[number]))
        time_s, read = record.time_s[known], record.sensors[number, known]
        moved = read - self.fitted.residual_degC(longest)[number, known]
        first, last = _longest_still(read)
        if 1 < len(np.unique(read)) < COARSE:
            return None
        if last - first < _STILL_SAMPLES or np.ptp(moved[first:last]) < _MOVED_DEGC or _wanders(read[first:last]):
            return None
        onset = None if first == 0 else float(time_s[first] - record.period_s / 2)
        end = None if last == len(known) else float(time_s[last - 1] + record.period_s / 2)
        return float(np.median(read[first:last])), onset, end

    def first_degC(self, node: str) -> float:
        """The first reading of a node's sensor."""
        return float(self._read(node)[0])

    def _read(self, node: str) -> Array:
        """All readings of a node's sensor."""
        sensor = list(self.network.reads).index(self.network.index(node))
        row = np.concatenate([record.sensors[sensor] for record in self.records])
        return row[np.isfinite(row)]

    def plateaus_degC(self, node: str) -> list[float]:
        """Temperatures at which a sensor stays for a third of the time: 0 degC, and one twentieth of its range."""
        if self.network.index(node) not in self.network.reads:
            return []
        row = self._read(node)
        counts, edges = np.histogram(row, bins=20)
        best = int(np.argmax(counts))
        dwell = float((edges[best] + edges[best + 1]) / 2)
        near = _WATER * np.ptp(row)
        points = [0.0] if np.mean(np.abs(row) < near / 2) > _DWELLS else []
        if counts[best] > _DWELLS * len(row) and all(abs(dwell - each) > near for each in points):
            points.append(dwell)
        return points


def is_flow(column: str) -> bool:
    """Whether a column is that of a flow, by its unit or its name."""
    return column.endswith(_FLOWS) or "flow" in column


def _varies(row: Array) -> bool:
    low, high = np.quantile(row, [0.02, 0.98])
    apart = np.abs(row - low) > _VARIES * np.abs(row).max()
    # a single sample may be a fault; a heater that was on once, shortly, is an experiment
    pulse = high == low and np.convolve(apart, np.ones(_PULSE), "valid").max(initial=0.0) == _PULSE
    return bool(high - low > _VARIES * np.abs(row).max() or pulse or (np.ptp(row) > 0 and len(np.unique(row)) == 2))


def _rest(row: Array) -> float | None:
    """Where a column rests, unless that is at nothing: a meter's reading of nothing, as of one from 1 to 5 V."""
    low, high = np.quantile(row, [0.02, 0.98])
    near = _NEAR_REST * (high - low)
    rest = float(np.median(row[np.abs(row - low) <= near]))
    return rest if np.mean(np.abs(row - rest) <= near) > _RESTS and rest > 2 * near else None


def _wanders(row: Array) -> bool:
    """Whether samples differ less from the one before than from the median: a stuck sensor flickers at most, and what
    melts or freezes creeps."""
    return bool(np.median(np.abs(np.diff(row))) < np.median(np.abs(row - np.median(row))))


def _longest_still(row: Array) -> tuple[int, int]:
    """The longest stretch of ``row`` within ``_STILL_DEGC``, as first and behind the last."""
    best, first = (0, 0), 0
    for last in range(1, len(row) + 1):
        while np.ptp(row[first:last]) > _STILL_DEGC:
            first += 1
        best = max(best, (first, last), key=lambda each: each[1] - each[0])
    return best
