"""Design of the next experiment: the input step after which two competing models' predictions differ most.

Both models are simulated from rest through every step of one logged input, or of one after the ambient has changed; the
step after which a sensor differs most, in units of what is left there, is proposed.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from ambient_trainer.data.trace import Array
from ambient_trainer.diagnosis.findings import cause_of, fitted_without, residuals_degC
from ambient_trainer.diagnosis.greybox.model import GreyBox
from ambient_trainer.diagnosis.greybox.regression import Fitted, simulate
from ambient_trainer.diagnosis.greybox.revision import is_same
from ambient_trainer.diagnosis.greybox.stepwise import Selection
from ambient_trainer.diagnosis.greybox.trials import Trial
from ambient_trainer.diagnosis.record import Record
from ambient_trainer.diagnosis.result import UNKNOWN, Step
from ambient_trainer.report.words import digits, duration

_LONGEST_S, _LONGEST_PERIODS, _SAMPLES = 4 * 3600.0, 120.0, 240
_STEPS_K = (10.0, -10.0)
_SURE = 3.0
"""Standard deviations between the two predictions."""
_USUAL = (0.02, 0.98)
_STARTS_DEGC, _BEYOND_K = 20.0, 15.0
"""Where planned runs begin; how far beyond what the log has seen a sensor may get."""


@dataclass(frozen=True)
class Difference:
    """Where two models differ most after ``column`` went from ``rest`` to ``level``: the sensor, the time since then,
    both readings, and the standard deviation there."""

    column: str
    rest: float
    level: float
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
    # the first cause by itself, as it was compared; else as it was chosen
    same = (each for each in selection.compared.trials if each.mechanism.key == chosen.mechanism.key)
    taken = next(same, chosen).fitted
    rival = _closest(selection, steps[0], chosen)
    other = selection.bare if rival is None else rival.fitted
    name = "nothing is missing" if rival is None else str(cause_of(rival.mechanism, other.model.circuit))
    if rival is not None and rival.mechanism.instrument > chosen.mechanism.instrument and rival.mechanism.places:
        return _second_thermometer(rival.mechanism.places[0], str(steps[0].cause), name)
    heat = [str(each) for each in steps[0].indistinguishable_from if each.name == "heat_source"]
    if chosen.mechanism.instrument and heat and not chosen.mechanism.places:
        moved = "Put the device and its reference into another room at once: both respond at the same logged time"
        return f"{moved} if the cause is {heat[0]}, at different ones if it is {steps[0].cause}."
    if chosen.mechanism.instrument and heat:
        return _second_thermometer(chosen.mechanism.places[0], heat[0], str(steps[0].cause))
    found = _largest(taken, other)
    if rival is None and (found is None or found.sigmas < _SURE) and (without := _without(selection.final, chosen)):
        found, name = _largest(selection.final, without), "only the other causes are there"
    if found is None or found.sigmas < _SURE:
        shows = "shows" if rival is None else f"distinguishes from {name}"
        return f"No step of one logged input {shows} {steps[0].cause}. Log longer, and more signals."
    return (
        f"From steady state, take `{found.column}` from {found.rest:g} to {found.level:g}:"
        f" after {duration(found.after_s)}, `{found.sensor}` reads {found.readings_degC[0]:.2f} degC if it is"
        f" {steps[0].cause}, {found.readings_degC[1]:.2f} degC if {name} (standard deviation"
        f" {digits(found.sd_degC, 2)} degC)."
    )


def _without(final: Fitted, chosen: Trial) -> Fitted | None:
    """The final model without what was chosen, fitted: a cause may show only beside others."""
    mechanisms = final.model.mechanisms
    index = next((i for i, each in enumerate(mechanisms) if is_same(each, chosen.mechanism)), None)
    return None if index is None else fitted_without(final, index)


def _second_thermometer(place: str, physics: str, fault: str) -> str:
    agree = f"it agrees with the sensor if the cause is {physics}"
    return f"Attach a second thermometer at `{place}`: {agree} and disagrees if it is {fault}."


def _closest(selection: Selection, step: Step, chosen: Trial) -> Trial | None:
    """The closest rival; but no experiment moves one of two columns that go together."""
    own = chosen.mechanism.cause, _columns(chosen)
    for each in selection.compared.trials:
        another = each.mechanism.cause != own[0] or _columns(each) == own[1]
        if another and cause_of(each.mechanism, each.fitted.model.circuit) in step.indistinguishable_from:
            return each
    return None


def _columns(trial: Trial) -> tuple[str, ...]:
    return () if trial.mechanism.driver is None else trial.mechanism.driver.columns


def _largest(one: Fitted, other: Fitted) -> Difference | None:
    """The switch after which two models differ most; of a driver of theirs, where that is sure."""
    drivers = _moved_by(one, other)
    sd = np.sqrt(np.nanmean(residuals_degC(one) ** 2, axis=1)) + 1e-6
    read = np.concatenate([record.sensors for record in one.records], axis=1)
    seen_degC = float(np.nanmin(read)) - _BEYOND_K, float(np.nanmax(read)) + _BEYOND_K
    found = (_difference(one, other, *switch, sd, seen_degC) for switch in _switches(one, other))
    return max(
        (each for each in found if each is not None),
        key=lambda each: (each.column in drivers and each.sigmas >= _SURE, each.sigmas),
        default=None,
    )


def _difference(
    one: Fitted, other: Fitted, column: str, rest: float, level: float, sd: Array, seen_degC: tuple[float, float]
) -> Difference | None:
    """Where the two differ most before a sensor leaves the range of the log, and some."""
    record = _planned(one, column, level)
    reads = np.stack([_simulated(each.model, record) for each in (one, other)])
    if not np.isfinite(reads).all():
        return None
    after = reads[:, :, _SAMPLES:]
    inside = np.logical_and.accumulate(((after > seen_degC[0]) & (after < seen_degC[1])).all(axis=(0, 1)))
    apart = np.abs(after[0] - after[1]) / sd[:, None] * inside
    if not inside.any():
        return None
    sensor, index = np.unravel_index(np.argmax(apart > 0.9 * apart.max()), apart.shape)
    readings = float(after[0, sensor, index]), float(after[1, sensor, index])
    name, after_s = one.model.circuit.outputs[sensor].name, float(index + 1) * record.period_s
    return Difference(column, rest, level, name, after_s, readings, float(sd[sensor]))


def _simulated(model: GreyBox, record: Record) -> Array:
    """What sensors read, (s, N); what acted for a while is made to act all the time."""
    permanent = tuple(replace(each, onset_s=None, end_s=None) for each in model.mechanisms)
    model = replace(model, mechanisms=permanent)
    nodes = len(model.network(record, model.z()[None]).nodes)
    return simulate(model, record, model.z()[None], np.full((1, nodes), _STARTS_DEGC))[0]


def _planned(one: Fitted, column: str, level: float) -> Record:
    """A record with every column at rest, and one of them at a level from its middle on."""
    period_s = max(_LONGEST_S, _LONGEST_PERIODS * one.records[0].period_s) / _SAMPLES
    columns = {name: np.full(2 * _SAMPLES, rest) for name, (rest, _) in _levels(one).items()}
    columns[column][_SAMPLES:] = level
    inputs = np.array([columns[name] for name in one.model.circuit.inputs])
    sensors = np.full((len(one.model.circuit.outputs), 2 * _SAMPLES), np.nan)
    return Record(period_s, period_s * np.arange(2 * _SAMPLES, dtype=np.float64), inputs, sensors, columns)


def _levels(one: Fitted) -> dict[str, tuple[float, list[float]]]:
    """Where each input and signal rests, and to which levels it may be taken: temperatures rest at their medians and
    move by some K, all else rests as near to nothing as was seen, and goes to the ends of that."""
    inputs, found = one.model.circuit.inputs, {}
    logged = pd.concat([pd.DataFrame({**dict(zip(inputs, each.inputs)), **each.signals}) for each in one.records])
    for name, row in logged.items():
        low, high = np.quantile(row, _USUAL)
        rest = float(round(np.median(row))) if name.endswith("_degC") else float(min(max(0.0, low), high))
        steps = [rest + step for step in _STEPS_K]
        found[name] = rest, steps if name.endswith("_degC") else [float(f"{each:.2g}") for each in (low, high)]
    return found


def _switches(one: Fitted, other: Fitted) -> Iterator[tuple[str, float, float]]:
    """Every input of the circuit and every driver of the two: where it rests, and the level to which it is taken."""
    names = [*one.model.circuit.inputs, *_moved_by(one, other)]
    for name, (rest, levels) in ((name, _levels(one)[name]) for name in dict.fromkeys(names)):
        yield from ((name, rest, level) for level in levels if level != rest)


def _moved_by(one: Fitted, other: Fitted) -> list[str]:
    """The columns of the two models' drivers."""
    drivers = [each.driver for model in (one.model, other.model) for each in model.mechanisms]
    return [name for each in drivers if each is not None for name in each.columns]


def _survey(final: Fitted) -> str:
    """Every input by itself; the sensor to watch is the one that is most off."""
    off, circuit = np.sqrt(np.nanmean(residuals_degC(final) ** 2, axis=1)), final.model.circuit
    worst, columns = int(np.argmax(off)), ", ".join(f"`{name}`" for name in circuit.inputs)
    return (
        f"From steady state, change {columns} one at a time and back again, and log what else acts on"
        f" `{circuit.outputs[worst].name}`, where {digits(off[worst], 2)} degC are unexplained."
    )
