"""What a candidate phone would have shown: statistics of its raw sensors, and errors of the thesis's static formulas.

Both without noise and rounding, which the calibration shall not fit.
"""

from collections.abc import Mapping, Sequence
from functools import cache
from typing import NamedTuple

import numpy as np

from ambient_studies.thesis.published import (
    CONSTANT_SCENARIOS,
    SensorStatistics,
    published_parameters,
    published_results,
    sensor_statistics,
)
from ambient_trainer.circuits import assemble, load_circuit
from ambient_trainer.data import Array
from ambient_trainer.evaluation import Metrics, score
from ambient_trainer.lti import dc_gain
from ambient_trainer.simulator import Driven, felt, integrate, load_device, load_scenario, prepare

SCENARIOS = (*CONSTANT_SCENARIOS, "3")
"""What candidates go through; 4 and 5 are left for the evaluation."""

FORMULAS = ("linear_battery", "linear_usb", "linear_flash", "linear_combined", "model1_kirchhoff", "model2_ss_free_cd")
"""Models whose published parameters constrain the sensors; the last by its DC gains."""

PERIOD_S = 2.0
_SENSORS = load_device().sensors


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
    """The published formulas at steady state, errata applied."""
    return {model: _steady_state(model) for model in FORMULAS}


def record(candidates: Sequence[Mapping[str, float]], seed: int) -> list[dict[str, Recorded]]:
    """Simulate every candidate in all ``SCENARIOS``, in one integration."""
    runs = []
    for values in candidates:
        device = load_device().with_values(values)
        runs += [prepare(load_scenario(name), seed, PERIOD_S, device) for name in SCENARIOS]
    recorded = [_recorded(each) for each in integrate(runs, PERIOD_S)]
    size = len(SCENARIOS)
    return [dict(zip(SCENARIOS, recorded[start : start + size])) for start in range(0, len(recorded), size)]


def statistics(recorded: Mapping[str, Recorded]) -> dict[tuple[str, str], SensorStatistics]:
    """Mean and standard deviation by scenario and sensor, for all that were published."""
    found = {}
    for scenario, sensor in sensor_statistics():
        values = recorded[scenario].sensors_degC[_SENSORS.index(sensor)]
        found[scenario, sensor] = SensorStatistics(float(values.mean()), float(values.std()))
    return found


def formula_errors(recorded: Mapping[str, Recorded]) -> dict[tuple[str, str], Metrics]:
    """Errors of the published formulas on what was recorded, by scenario and model."""
    return {
        (scenario, model): score(air_degC - gains @ sensors_degC - offset)
        for scenario, (air_degC, sensors_degC) in recorded.items()
        for model, (gains, offset) in formulas().items()
        if (scenario, model) in published_results()
    }


def _steady_state(model: str) -> Formula:
    circuit = load_circuit(model)
    system = assemble(circuit, published_parameters()[model].corrected).value
    gains = np.zeros(len(_SENSORS))
    gains[[_SENSORS.index(column.removesuffix("_degC")) for column in circuit.inputs]] = dc_gain(system)[0]
    return Formula(gains, float(system.offset[0]))


def _recorded(driven: Driven) -> Recorded:
    kept = slice(driven.run.unrecorded, None)
    sensors = [
        felt(zone, driven.run.device, driven.nodes_degC, PERIOD_S)[kept] for zone in driven.run.device.main_zones
    ]
    return Recorded(driven.run.air_degC[kept], np.array(sensors))
