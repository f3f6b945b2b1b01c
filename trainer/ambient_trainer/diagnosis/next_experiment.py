"""The next experiment: what to switch, which sensor to read, and what each of two explanations predicts for it.

Both models are simulated from rest through every step of one logged input, or of one after the ambient has changed; the
step after which a sensor differs most, in units of what is left there, is proposed.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ambient_trainer.data.trace import Array
from ambient_trainer.diagnosis.findings import cause_of
from ambient_trainer.diagnosis.greybox.model import GreyBox
from ambient_trainer.diagnosis.greybox.regression import Fitted, simulate
from ambient_trainer.diagnosis.greybox.stepwise import Selection
from ambient_trainer.diagnosis.greybox.trials import Trial
from ambient_trainer.diagnosis.record import Record
from ambient_trainer.diagnosis.result import UNKNOWN, Step
from ambient_trainer.diagnosis.words import digits, duration

_LONGEST_S, _LONGEST_PERIODS, _SAMPLES = 4 * 3600.0, 120.0, 240
_STEPS_K = (10.0, -10.0)
_SURE = 3.0
"""Standard deviations between the two predictions."""
_USUAL = (0.02, 0.98)
_STARTS_DEGC, _BEYOND_K = 20.0, 15.0
"""Where planned runs begin; how far beyond what the log has seen a sensor may get."""


@dataclass(frozen=True)
class Switch:
    """A column goes from its level at rest to another one."""

    column: str
    rest: float
    level: float


@dataclass(frozen=True)
class Difference:
    """Where two models differ most after a switch: sensor, time since then, both readings, and the deviation there."""

    switch: Switch
    sensor: str
    after_s: float
    readings_degC: tuple[float, float]
    sd_degC: float

    @property
    def sigmas(self) -> float:
        """How far apart they are."""
        return abs(self.readings_degC[0] - self.readings_degC[1]) / self.sd_degC


def next_experiment(selection: Selection, steps: Sequence[Step]) -> str:
    """What to do to distinguish the first cause from its closest rival; without rivals, from its absence."""
    if not steps:
        return ""
    if steps[0].cause.name == UNKNOWN:
        return _survey(selection.final)
    chosen = selection.steps[0].chosen
    assert chosen is not None
    taken = _alone(selection, chosen)
    rival = _closest(selection, steps[0], chosen)
    other = selection.bare if rival is None else rival.fitted
    name = "nothing is missing" if rival is None else str(cause_of(rival.mechanism, other.model.circuit))
    if rival is not None and rival.mechanism.instrument > chosen.mechanism.instrument and rival.mechanism.places:
        return _second_thermometer(rival.mechanism.places[0], str(steps[0].cause), name)
    heat = [str(each) for each in steps[0].indistinguishable_from if each.name == "heat_source"]
    if chosen.mechanism.instrument and heat:
        return _second_thermometer(chosen.mechanism.places[0], heat[0], str(steps[0].cause))
    found = _largest(taken, other)
    if found is None or found.sigmas < _SURE:
        return f"No step of one logged input separates {steps[0].cause} from this: {name}. Log twice as long, and more."
    switch = found.switch
    sd = f"(standard deviation {digits(found.sd_degC, 2)} degC)"
    return (
        f"From rest, take `{switch.column}` from {switch.rest:g} to {switch.level:g}: after {duration(found.after_s)},"
        f" `{found.sensor}` reads {found.readings_degC[0]:.2f} degC if {steps[0].cause},"
        f" {found.readings_degC[1]:.2f} degC if {name} {sd}."
    )


def _second_thermometer(place: str, physics: str, fault: str) -> str:
    return f"Hold a second thermometer to `{place}`: it reads the same if {physics}, and not if {fault}."


def _alone(selection: Selection, chosen: Trial) -> Fitted:
    """The first cause by itself, as it was compared; else as it was chosen."""
    same = (each for each in selection.compared.trials if each.mechanism.key == chosen.mechanism.key)
    return next(same, chosen).fitted


def _closest(selection: Selection, step: Step, chosen: Trial) -> Trial | None:
    """The closest rival; but no experiment moves one of two columns that go together."""
    own = () if chosen.mechanism.driver is None else chosen.mechanism.driver.columns
    for each in selection.compared.trials:
        driver = each.mechanism.driver
        if each.mechanism.cause == chosen.mechanism.cause and (() if driver is None else driver.columns) != own:
            continue
        if cause_of(each.mechanism, each.fitted.model.circuit) in step.indistinguishable_from:
            return each
    return None


def _largest(one: Fitted, other: Fitted) -> Difference | None:
    """The switch after which two models differ most."""
    left = np.concatenate([one.residual_degC(index) for index in range(len(one.records))], axis=1)
    sd = np.sqrt(np.nanmean(left**2, axis=1)) + 1e-6
    read = np.concatenate([record.sensors for record in one.records], axis=1)
    seen_degC = float(np.nanmin(read)) - _BEYOND_K, float(np.nanmax(read)) + _BEYOND_K
    found = (_difference(one, other, switch, sd, seen_degC) for switch in _switches(one, other))
    return max((each for each in found if each is not None), key=lambda each: each.sigmas, default=None)


def _difference(
    one: Fitted, other: Fitted, switch: Switch, sd: Array, seen_degC: tuple[float, float]
) -> Difference | None:
    """Where the two differ most before a sensor leaves the range of the log, and some."""
    record = _planned(one, switch)
    reads = [_simulated(each.model, record) for each in (one, other)]
    if not all(np.isfinite(each).all() for each in reads):
        return None
    half = record.samples // 2
    after = np.stack(reads)[:, :, half:]
    inside = np.logical_and.accumulate(((after > seen_degC[0]) & (after < seen_degC[1])).all(axis=(0, 1)))
    apart = np.abs(after[0] - after[1]) / sd[:, None] * inside
    if not inside.any():
        return None
    sensor, index = np.unravel_index(np.argmax(apart > 0.9 * apart.max()), apart.shape)
    at = half + int(index)
    readings = float(reads[0][sensor, at]), float(reads[1][sensor, at])
    name = one.model.circuit.outputs[sensor].name
    return Difference(switch, name, float(index + 1) * record.period_s, readings, float(sd[sensor]))


def _simulated(model: GreyBox, record: Record) -> Array:
    """What sensors read, (s, N); what acted for a while is made to act all the time."""
    lasting = tuple(replace(each, onset_s=None, end_s=None) for each in model.mechanisms)
    model = replace(model, mechanisms=lasting)
    nodes = len(model.network(record, model.z()[None]).nodes)
    return simulate(model, record, model.z()[None], np.full((1, nodes), _STARTS_DEGC))[0]


def _planned(one: Fitted, switch: Switch) -> Record:
    """A record at rest for a half, and after the switch for the other."""
    period_s = max(_LONGEST_S, _LONGEST_PERIODS * one.records[0].period_s) / _SAMPLES
    time_s: Array = period_s * np.arange(2 * _SAMPLES, dtype=np.float64)
    rest = _rest(one)
    columns = {name: np.full(len(time_s), level) for name, level in rest.items()}
    columns[switch.column] = np.where(np.arange(len(time_s)) < _SAMPLES, switch.rest, switch.level)
    inputs: Array = np.array([columns[name] for name in one.model.circuit.inputs], dtype=np.float64)
    sensors = np.full((len(one.model.circuit.outputs), len(time_s)), np.nan)
    return Record(period_s, time_s, inputs, sensors, columns)


def _logged(one: Fitted) -> Mapping[str, Array]:
    """All columns of all records: inputs and signals."""
    inputs = one.model.circuit.inputs
    rows = {name: [record.inputs[at] for record in one.records] for at, name in enumerate(inputs)}
    rows |= {name: [record.signals[name] for record in one.records] for name in one.records[0].signals}
    return {name: np.concatenate(parts) for name, parts in rows.items()}


def _rest(one: Fitted) -> dict[str, float]:
    """Temperatures at their medians, all else as near to nothing as was seen."""
    rest = {}
    for name, row in _logged(one).items():
        low, high = np.quantile(row, _USUAL)
        rest[name] = float(round(np.median(row))) if name.endswith("_degC") else float(min(max(0.0, low), high))
    return rest


def _switches(one: Fitted, other: Fitted) -> Iterator[Switch]:
    """Every input of the circuit and every driver of the two, to the ends of what was seen; temperatures by some K."""
    logged, rest = _logged(one), _rest(one)
    drivers = [each.driver for model in (one.model, other.model) for each in model.mechanisms]
    names = [*one.model.circuit.inputs, *(name for each in drivers if each is not None for name in each.columns)]
    for name in dict.fromkeys(names):
        if name.endswith("_degC"):
            levels = [rest[name] + step for step in _STEPS_K]
        else:
            levels = [float(f"{each:.2g}") for each in np.quantile(logged[name], _USUAL)]
        yield from (Switch(name, rest[name], level) for level in levels if level != rest[name])


def _survey(final: Fitted) -> str:
    """Every input by itself; the sensor to watch is the one that is most off."""
    left = np.concatenate([final.residual_degC(index) for index in range(len(final.records))], axis=1)
    off = np.sqrt(np.nanmean(left**2, axis=1))
    worst = int(np.argmax(off))
    rest = _rest(final)
    columns = [f"`{name}`" for name in final.model.circuit.inputs if name in rest]
    return (
        f"From rest, change {', '.join(columns)} one at a time and back again, and log what else goes on at"
        f" `{final.model.circuit.outputs[worst].name}`, where {digits(off[worst], 2)} degC are unexplained."
    )
