"""What a candidate phone would have shown: raw sensors' statistics, and the errors of the thesis's static formulas.

Statistics are of what the sensors feel, without noise and rounding: the calibration shall not fit those.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ambient_studies.calibration.published import CONSTANT_SCENARIOS, Errors, published_errors, sensor_figures
from ambient_studies.thesis.parameters import published_parameters
from ambient_trainer.circuits.assemble import assemble
from ambient_trainer.circuits.schema import load_circuit
from ambient_trainer.lti.statespace import dc_gain
from ambient_trainer.simulator.device import from_values
from ambient_trainer.simulator.instruments import felt
from ambient_trainer.simulator.run import Driven, integrate, prepare
from ambient_trainer.simulator.scenario import load_scenario
from ambient_trainer.simulator.zones import thesis_zones

Array = NDArray[np.float64]
Values = Mapping[str, float]

SCENARIOS = (*CONSTANT_SCENARIOS, "3")
"""What candidates are put through; 4 and 5 are left for the evaluation."""

FORMULAS = ("linear_battery", "linear_usb", "linear_flash", "linear_combined", "model1_kirchhoff", "model2_ss_free_cd")
"""Models whose published parameters say what the sensors were; the last by its gains at rest."""

PERIOD_S = 2.0
_SENSORS = tuple(zone.name for zone in thesis_zones())


class Formula(NamedTuple):
    """ambient = gains . sensors + offset."""

    gains: Array
    offset: float


class Recorded(NamedTuple):
    """One scenario without instruments' errors: the air, shape (n,), and what the five sensors feel, (5, n)."""

    air_degC: Array
    sensors_degC: Array


@cache
def formulas() -> dict[str, Formula]:
    """The published formulas at rest, errata applied."""
    return {model: _at_rest(model) for model in FORMULAS}


def record(candidates: Sequence[Values], seed: int) -> list[dict[str, Recorded]]:
    """Every candidate through all ``SCENARIOS``, in one integration."""
    runs = []
    for values in candidates:
        phone, chamber = from_values(values)
        runs += [prepare(load_scenario(name), seed, PERIOD_S, phone, chamber) for name in SCENARIOS]
    recorded = [_recorded(each) for each in integrate(runs, PERIOD_S)]
    size = len(SCENARIOS)
    return [dict(zip(SCENARIOS, recorded[start : start + size])) for start in range(0, len(recorded), size)]


def statistics(recorded: Mapping[str, Recorded]) -> dict[tuple[str, str], tuple[float, float]]:
    """Mean and standard deviation in degC by scenario and sensor, for all that were published."""
    found = {}
    for each in sensor_figures():
        values = recorded[each.scenario].sensors_degC[_SENSORS.index(each.sensor)]
        found[each.scenario, each.sensor] = float(values.mean()), float(values.std())
    return found


def formula_errors(recorded: Mapping[str, Recorded]) -> dict[tuple[str, str], Errors]:
    """What the published formulas would have erred by, by scenario and model."""
    found = {}
    for scenario, (air_degC, sensors_degC) in recorded.items():
        for model, (gains, offset) in formulas().items():
            if (scenario, model) in published_errors():
                error = air_degC - gains @ sensors_degC - offset
                found[scenario, model] = Errors(
                    float(np.sqrt(np.mean(error**2))), float(np.abs(error).mean()), float(error.mean())
                )
    return found


def _at_rest(model: str) -> Formula:
    circuit = load_circuit(model)
    system = assemble(circuit, published_parameters()[model].corrected).value
    gains = np.zeros(len(_SENSORS))
    for column, gain in zip(circuit.inputs, dc_gain(system)[0].tolist()):
        gains[_SENSORS.index(column.removesuffix("_degC"))] = gain
    return Formula(gains, float(system.offset[0]))


def _recorded(driven: Driven) -> Recorded:
    kept = slice(driven.run.unrecorded, None)
    sensors = [felt(zone, driven.run.phone, driven.nodes_degC, PERIOD_S)[kept] for zone in thesis_zones()]
    return Recorded(driven.run.air_degC[kept], np.array(sensors))
