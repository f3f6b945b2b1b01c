"""The errors of the thesis's text, computed from its own tables; erratum 8 (a moving ambient) from simulated runs."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib import resources

import numpy as np
import yaml

from ambient_studies.thesis import published as thesis
from ambient_studies.thesis.methods import fit_model, printed_models
from ambient_studies.thesis.moving_ambient import INPUTS, fit_with_moving_ambient
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
    unit: str = ""


@dataclass(frozen=True)
class Erratum:
    """A statement of the text, what is wrong with it, and the figures that show it."""

    number: int
    title: str
    statement: str
    figures: tuple[Figure, ...]


def computed_errata(training: Trace, ambient_change: Trace) -> list[Erratum]:
    """Compute every erratum that has figures, by number; raises :class:`Refused` where a trace lacks a column.

    Erratum 8 is fitted to ``training``, a run of scenario 5, and measured on ``ambient_change``, one of scenario 3.
    """
    found = [*text_errata(), _erratum(8, _moving_ambient(training, ambient_change))]
    return sorted(found, key=lambda each: each.number)


def text_errata() -> list[Erratum]:
    """Those that follow from the thesis's own tables."""
    figures = {
        1: _sign,
        2: _capacitance,
        3: _order_of_conductances,
        5: _order_of_sensors,
        6: _weight,
        7: _objective,
        9: _offset,
        10: _missing_loss,
        11: _quoted,
    }
    return [_erratum(number, of()) for number, of in figures.items()]


def _erratum(number: int, figures: Iterable[Figure]) -> Erratum:
    return Erratum(number, **_TEXTS[number], figures=tuple(figures))


def _moving_ambient(training: Trace, ambient_change: Trace) -> Iterator[Figure]:
    """The best model with the balance as it is printed, and with -dT_amb/dt in it."""
    without = fit_model("model2_ss_free_cd", training).estimate_degC
    system = fit_with_moving_ambient(training)
    for where, trace in (("on the moving ambient", ambient_change), ("in training", training)):
        with_term = estimate_degC(system, "first-order", INPUTS, trace)
        yield Figure(f"RMSE {where}, C d(T - T_amb)/dt as printed", _rmse(trace, without(trace)), "degC")
        yield Figure(f"RMSE {where}, C dT/dt", _rmse(trace, with_term), "degC")


def _sign() -> Iterator[Figure]:
    model = "model2_ss_free_cd"
    sensors = _sensors(load_circuit(model).inputs)
    gains = {what: dc_gain(system)[0] for what, system in _systems(model).items()}
    for what, values in gains.items():
        yield from (Figure(f"DC gain of {name}, {what}", float(gain)) for name, gain in zip(sensors, values))
        yield Figure(f"sum of the gains, {what}", float(values.sum()))
    yield Figure("idle estimate at 20 degC, printed", float(gains["printed"] @ _means("1", sensors)), "degC")
    corrected = dict(zip(sensors, gains["corrected"].tolist()))
    display = corrected.pop("display")
    for scenario in thesis.CONSTANT_SCENARIOS:
        estimate = _TRUTH_DEGC - thesis.published_results()[scenario, model].mbe_degC
        others = sum(gain * thesis.sensor_statistics()[scenario, name].mean_degC for name, gain in corrected.items())
        implied = (estimate - others) / display
        yield Figure(f"display mean implied in scenario {scenario}, corrected", implied, "degC")


def _capacitance() -> Iterator[Figure]:
    printed, corrected = (np.linalg.eigvals(each.A) for each in _systems("model2_ss_single_input").values())
    oscillating = printed[np.argmax(printed.imag)]
    yield Figure("oscillating pole as printed, real part", float(oscillating.real), "1/s")
    yield Figure("oscillating pole as printed, imaginary part", float(oscillating.imag), "rad/s")
    yield from (Figure("pole as corrected", float(pole), "1/s") for pole in sorted(corrected.real, reverse=True))
    yield Figure("largest imaginary part as corrected", float(np.abs(corrected.imag).max()), "rad/s")


def _order_of_conductances() -> Iterator[Figure]:
    for what, system in _systems("model2_ss_single_input").items():
        yield from (Figure(f"weight of {node}, {what}", float(each)) for node, each in zip(_STATES, system.C[0]))


def _order_of_sensors() -> Iterator[Figure]:
    model = "linear_combined"
    inputs = {"printed": printed_models()[model].inputs, "corrected": load_circuit(model).inputs}
    names = {"printed": "mean error in scenario 2.1, printed order", "corrected": "mean error, corrected order"}
    for what, system in _systems(model).items():
        estimate = float(system.D[0] @ _means("2.1", _sensors(inputs[what])) + system.offset[0])
        yield Figure(names[what], _TRUTH_DEGC - estimate, "degC")
    yield Figure("mean error, published", thesis.published_results()["2.1", model].mbe_degC, "degC")


def _weight() -> Iterator[Figure]:
    published, circuit = thesis.published_parameters()["model2_ss"], load_circuit("model2_ss")
    for what, values in (("printed", published.printed), ("corrected", published.corrected)):
        idle = float(dc_gain(assemble(circuit, values).value)[0] @ _means("1", _sensors(circuit.inputs)))
        yield Figure(f"w1, {what}", values["w1"])
        yield Figure(f"sum of the weights, {what}", values["w1"] + values["w2"] + values["w3"])
        yield Figure(f"idle estimate at 20 degC, {what}", idle, "degC")
    yield Figure("idle RMSE, published", thesis.published_results()["1", "model2_ss"].rmse_degC, "degC")


def _objective() -> Iterator[Figure]:
    single = [result for (_, model), result in thesis.published_results().items() if model == thesis.NONCAUSAL]
    yield Figure("largest mean error of Model 1 single input", max(abs(each.mbe_degC) for each in single), "degC")
    yield Figure("its largest RMSE", max(each.rmse_degC for each in single), "degC")


def _offset() -> Iterator[Figure]:
    for what, single in (("scenarios", True), ("results of the other models", False)):
        found = [
            each for (_, model), each in thesis.published_results().items() if (model == thesis.NONCAUSAL) == single
        ]
        yield Figure(what, len(found))
        yield Figure("with mean error 0.00 and symmetric intervals", sum(map(_symmetric, found)))


def _missing_loss() -> Iterator[Figure]:
    model = "model2_ss_single_input"
    gain = float(dc_gain(_systems(model)["corrected"])[0][0])
    idle = _TRUTH_DEGC - gain * thesis.sensor_statistics()["1", "display"].mean_degC
    yield Figure("DC gain of the display in Model 2 single input", gain)
    yield Figure("mean error implied when idle", idle, "degC")
    yield Figure("mean error when idle, published", thesis.published_results()["1", model].mbe_degC, "degC")


def _quoted() -> Iterator[Figure]:
    yield Figure("MAE of Model 2 random C & D in section 5.3", 0.90, "degC")
    yield Figure("in table 5.1", thesis.published_results()["4", "model2_ss_free_cd"].mae_degC, "degC")
    yield Figure("scenarios with results", len({scenario for scenario, _ in thesis.published_results()}))


def _systems(model: str) -> dict[str, StateSpace]:
    """A model as printed and as corrected, both with the printed parameters."""
    corrected = assemble(load_circuit(model), thesis.published_parameters()[model].printed).value
    return {"printed": printed_models()[model].system, "corrected": corrected}


def _sensors(columns: Sequence[str]) -> list[str]:
    return [column.removesuffix("_degC") for column in columns]


def _means(scenario: str, sensors: Sequence[str]) -> Array:
    return np.array([thesis.sensor_statistics()[scenario, name].mean_degC for name in sensors])


def _symmetric(result: thesis.Result) -> bool:
    return result.mbe_degC == 0 and all(low == -high for low, high in result.interval_degC.values())


def _rmse(trace: Trace, estimate: Array) -> float:
    return float(np.sqrt(np.nanmean((trace.reference - estimate) ** 2)))
