"""The errors of the thesis's text, computed from its own tables; erratum 8 (a moving ambient) from simulated runs."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import resources

import numpy as np
import yaml

from ambient_studies.thesis.methods import fit_model, printed_models
from ambient_studies.thesis.moving_ambient import INPUTS, fit_with_moving_ambient
from ambient_studies.thesis.published import (
    CONSTANT_SCENARIOS,
    NONCAUSAL,
    Result,
    published_parameters,
    published_results,
    sensor_statistics,
)
from ambient_trainer.circuits import assemble, load_circuit
from ambient_trainer.data import Array, Trace
from ambient_trainer.estimators import estimate_degC
from ambient_trainer.lti import StateSpace, dc_gain

_TRUTH_DEGC = 20.0
"""The ambient of the constant scenarios."""
_STATES = ("flash", "battery", "usb")
_TEXTS: Mapping[int, Mapping[str, str]] = yaml.safe_load((resources.files(__package__) / "errata.yaml").read_text())


@dataclass(frozen=True)
class Figure:
    """A number that shows an error; ``unit`` is empty for a plain number."""

    what: str
    value: float
    unit: str


@dataclass(frozen=True)
class Erratum:
    """A statement of the text, what is wrong with it, and the figures that show it."""

    number: int
    title: str
    statement: str
    figures: tuple[Figure, ...]


def computed_errata(training: Trace, ambient_change: Trace) -> list[Erratum]:
    """Compute every erratum that has figures.

    Parameters
    ----------
    training, ambient_change : Trace
        Runs of scenarios 5 and 3: erratum 8 is fitted to the first and measured on the second.

    Returns
    -------
    list of Erratum
        By number.

    Raises
    ------
    Refused
        Where a trace lacks a column.
    """
    found = [*text_errata(), _erratum(8, _moving_ambient(training, ambient_change))]
    return sorted(found, key=lambda each: each.number)


def text_errata() -> list[Erratum]:
    """Those that follow from the thesis's own tables."""
    figures = {
        1: _sign(),
        2: _capacitance(),
        3: _order_of_conductances(),
        5: _order_of_sensors(),
        6: _weight(),
        7: _objective(),
        9: _offset(),
        10: _missing_loss(),
        11: _quoted(),
    }
    return [_erratum(number, each) for number, each in figures.items()]


def implied_display_degC(gains: Mapping[str, float], scenario: str) -> float:
    """The display's mean in ``scenario`` that the published mean error implies with these DC gains by sensor."""
    estimate = _TRUTH_DEGC - published_results()[scenario, "model2_ss_free_cd"].mbe_degC
    others = sum(
        gain * sensor_statistics()[scenario, name].mean_degC for name, gain in gains.items() if name != "display"
    )
    return (estimate - others) / gains["display"]


def _erratum(number: int, figures: Sequence[Figure]) -> Erratum:
    return Erratum(number, **_TEXTS[number], figures=tuple(figures))


def _moving_ambient(training: Trace, ambient_change: Trace) -> list[Figure]:
    """The best model with the balance as it is printed, and with -dT_amb/dt in it."""
    without = fit_model("model2_ss_free_cd", training).estimate_degC
    system = fit_with_moving_ambient(training)
    figures = []
    for where, trace in (("on the moving ambient", ambient_change), ("in training", training)):
        with_term = estimate_degC(system, "first-order", INPUTS, trace)
        figures.append(Figure(f"RMSE {where}, C d(T - T_amb)/dt as printed", _rmse(trace, without(trace)), "degC"))
        figures.append(Figure(f"RMSE {where}, C dT/dt", _rmse(trace, with_term), "degC"))
    return figures


def _sign() -> list[Figure]:
    sensors = _sensors(load_circuit("model2_ss_free_cd").inputs)
    gains = {what: dc_gain(system)[0] for what, system in _systems("model2_ss_free_cd").items()}
    figures = []
    for what, values in gains.items():
        figures += [Figure(f"DC gain of {name}, {what}", float(gain), "") for name, gain in zip(sensors, values)]
        figures.append(Figure(f"sum of the gains, {what}", float(values.sum()), ""))
    idle = float(gains["printed"] @ _means("1", sensors))
    figures.append(Figure("idle estimate at 20 degC, printed", idle, "degC"))
    for scenario in CONSTANT_SCENARIOS:
        implied = implied_display_degC(dict(zip(sensors, gains["corrected"].tolist())), scenario)
        figures.append(Figure(f"display mean implied in scenario {scenario}, corrected", implied, "degC"))
    return figures


def _capacitance() -> list[Figure]:
    printed, corrected = (np.linalg.eigvals(each.A) for each in _systems("model2_ss_single_input").values())
    oscillating = printed[np.argmax(printed.imag)]
    return [
        Figure("oscillating pole as printed, real part", float(oscillating.real), "1/s"),
        Figure("oscillating pole as printed, imaginary part", float(oscillating.imag), "rad/s"),
        *(Figure("pole as corrected", float(pole), "1/s") for pole in sorted(corrected.real, reverse=True)),
        Figure("largest imaginary part as corrected", float(np.abs(corrected.imag).max()), "rad/s"),
    ]


def _order_of_conductances() -> list[Figure]:
    return [
        Figure(f"weight of {node}, {what}", float(weight), "")
        for what, system in _systems("model2_ss_single_input").items()
        for node, weight in zip(_STATES, system.C[0])
    ]


def _order_of_sensors() -> list[Figure]:
    def error_degC(system: StateSpace, inputs: Sequence[str]) -> float:
        return _TRUTH_DEGC - float(system.D[0] @ _means("2.1", _sensors(inputs)) + system.offset[0])

    model = "linear_combined"
    systems, printed = _systems(model), printed_models()[model].inputs
    corrected = error_degC(systems["corrected"], load_circuit(model).inputs)
    return [
        Figure("mean error in scenario 2.1, printed order", error_degC(systems["printed"], printed), "degC"),
        Figure("mean error, corrected order", corrected, "degC"),
        Figure("mean error, published", published_results()["2.1", model].mbe_degC, "degC"),
    ]


def _weight() -> list[Figure]:
    published, circuit = published_parameters()["model2_ss"], load_circuit("model2_ss")
    figures = []
    for what, values in (("printed", published.printed), ("corrected", published.corrected)):
        idle = float(dc_gain(assemble(circuit, values).value)[0] @ _means("1", _sensors(circuit.inputs)))
        figures += [
            Figure(f"w1, {what}", values["w1"], ""),
            Figure(f"sum of the weights, {what}", values["w1"] + values["w2"] + values["w3"], ""),
            Figure(f"idle estimate at 20 degC, {what}", idle, "degC"),
        ]
    return [*figures, Figure("idle RMSE, published", published_results()["1", "model2_ss"].rmse_degC, "degC")]


def _objective() -> list[Figure]:
    single = [result for (_, model), result in published_results().items() if model == NONCAUSAL]
    return [
        Figure("largest mean error of Model 1 single input", max(abs(each.mbe_degC) for each in single), "degC"),
        Figure("its largest RMSE", max(each.rmse_degC for each in single), "degC"),
    ]


def _offset() -> list[Figure]:
    figures = []
    for what, single in (("scenarios", True), ("results of the other models", False)):
        found = [each for (_, model), each in published_results().items() if (model == NONCAUSAL) == single]
        symmetric = sum(map(_symmetric, found))
        figures += [
            Figure(what, len(found), ""),
            Figure("with mean error 0.00 and symmetric intervals", symmetric, ""),
        ]
    return figures


def _missing_loss() -> list[Figure]:
    model = "model2_ss_single_input"
    gain = float(dc_gain(_systems(model)["corrected"])[0][0])
    idle = _TRUTH_DEGC - gain * sensor_statistics()["1", "display"].mean_degC
    return [
        Figure("DC gain of the display in Model 2 single input", gain, ""),
        Figure("mean error implied when idle", idle, "degC"),
        Figure("mean error when idle, published", published_results()["1", model].mbe_degC, "degC"),
    ]


def _quoted() -> list[Figure]:
    return [
        Figure("MAE of Model 2 random C & D in section 5.3", 0.90, "degC"),
        Figure("in table 5.1", published_results()["4", "model2_ss_free_cd"].mae_degC, "degC"),
        Figure("scenarios with results", len({scenario for scenario, _ in published_results()}), ""),
    ]


def _systems(model: str) -> dict[str, StateSpace]:
    """A model as printed and as corrected, both with the printed parameters."""
    corrected = assemble(load_circuit(model), published_parameters()[model].printed).value
    return {"printed": printed_models()[model].system, "corrected": corrected}


def _sensors(columns: Sequence[str]) -> list[str]:
    return [column.removesuffix("_degC") for column in columns]


def _means(scenario: str, sensors: Sequence[str]) -> Array:
    return np.array([sensor_statistics()[scenario, name].mean_degC for name in sensors])


def _symmetric(result: Result) -> bool:
    return result.mbe_degC == 0 and all(low == -high for low, high in result.interval_degC.values())


def _rmse(trace: Trace, estimate: Array) -> float:
    return float(np.sqrt(np.nanmean((trace.reference - estimate) ** 2)))
