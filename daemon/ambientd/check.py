"""``ambientd check``: verifies a model file's recursion, its sensors and its outputs on this device."""

import math
import os
import time
from collections.abc import Callable, Sequence

from ambient_model.codec import load_model
from ambient_model.conformance import (
    TOLERANCE,
    TOLERANCE_DEGC,
    worst_contradiction_of_secondary,
    worst_contradictions,
    worst_difference_degC,
)
from ambient_model.faults import Fault, Refused, refuse
from ambient_model.intake import read_whole
from ambient_model.model import Model
from ambient_model.validation import SENTINELS_DEGC
from ambientd.consumers import followed
from ambientd.publish.proof import created, name_of, prove
from ambientd.reference import LARGEST_BYTES
from ambientd.settings import Settings
from ambientd.sources.assign import assigned_sensors, location_of
from ambientd.sources.quantities import reference_degC
from ambientd.sources.sensors import values_of
from ambientd.sources.supervision import outside, wrong_unit

_REGRESSORS = {"movement": "with the rate of change"} | dict.fromkeys(
    ("guard", "guard_above", "guard_below"), "with the difference to the secondary estimate"
)
"""What an error variance model's terms are of."""
_APART_K = 5.0
"""How far from the median of all a sensor is, at least, that is doubted because it reads a known error value."""


def check_files(settings: Settings) -> None:
    """Print the model and verify its recursion; raises :class:`Refused` where either fails."""
    model = load_model(settings.model)
    _describe(settings, model)
    worst_degC = worst_difference_degC(model)
    if not worst_degC <= TOLERANCE_DEGC:
        raise refuse(
            settings.model,
            "conformance",
            f"this device's outputs differ by {worst_degC:g} degC from the file's, and {TOLERANCE_DEGC:g} is allowed",
            "export the model again with 'ambient-trainer fit'; where it fails again, this Python computes wrong",
        )
    rows = len(model.conformance.inputs)
    _print("conformance", f"passed: {rows} samples at {len(model.main.discrete)} periods, to {worst_degC:g} degC")
    _check_fallbacks(model)
    if model.secondary is not None:
        _check_secondary(model)


def _check_fallbacks(model: Model) -> None:
    """Check the fallbacks for self-consistency, as the file holds no outputs of theirs."""
    worst = worst_contradictions(model)
    doubtful = [name for name in worst if not worst[name] <= TOLERANCE]
    for name in doubtful:
        _print("warning", f"without {name} the fallback contradicts itself by {_by(worst[name])}")
    if worst and not doubtful:
        _print("", f"passed: {len(worst)} fallbacks keep their equilibrium, and their periods agree")


def _check_secondary(model: Model) -> None:
    """The same of the secondary estimator."""
    worst = worst_contradiction_of_secondary(model)
    if worst <= TOLERANCE:
        _print("", "passed: the secondary estimator keeps its equilibrium, and its periods agree")
    else:
        _print("warning", f"the secondary estimator contradicts itself by {_by(worst)}")


def _by(contradiction: float) -> str:
    return f"{contradiction:g} (equilibrium moves, or periods disagree)"


def _describe(settings: Settings, model: Model) -> None:
    _print("model", f"{model.name}, created {model.created}")
    for each in model.main.inputs:
        _print("input", f"{each.column}, {each.min:g} to {each.max:g}, {location_of(settings, each)}")
    _print("states", ", ".join(model.main.states) or "none")
    _print("periods", f"{', '.join(f'{each.period_s:g}' for each in model.main.discrete)} s")
    _print("interval", _interval(model, settings.level_percent))
    if model.secondary is not None:
        threshold_degC = model.secondary.threshold_degC
        _print("secondary", f"blended from {threshold_degC:g} degC difference, alone from {2 * threshold_degC:g} degC")
    _print("fallbacks", ", ".join(f"without {name}" for name in model.fallbacks) or "none")


def _interval(model: Model, level_percent: int) -> str:
    if model.error_variance is None:
        low, high = model.main.interval[level_percent]
        return f"{low:+g} to {high:+g} degC around the estimate, {level_percent} %"
    sigma = math.sqrt(model.error_variance.constant_degC2)
    low, high = (end * sigma for end in model.error_variance.quantiles[level_percent])
    wider = list(dict.fromkeys(_REGRESSORS[term.of] for term in model.error_variance.terms))
    around = "degC around the estimate in steady state"
    beyond = model.error_variance.beyond
    wider += [f"outside of {beyond.low_degC:.1f} to {beyond.high_degC:.1f} degC"] if beyond else []
    interval = f"{low:+.2g} to {high:+.2g} {around}, {level_percent} %"
    return f"{interval}; wider {', '.join(wider)}" if wider else interval


def check_sensors(settings: Settings) -> None:
    """Print what each input's sensor reads now; raises :class:`Refused` where one has no usable value."""
    faults = []
    sensors = assigned_sensors(settings, load_model(settings.model))
    for sensor in sensors:
        sensor.open()
    values = values_of(sensors)
    for sensor in sensors:
        sensor.close()
    temperatures = [value for each, value in zip(sensors, values) if each.given.unit == "degC" and value is not None]
    for sensor, value in zip(sensors, values):
        place = f"sensor {sensor.name}"
        if value is None:
            faults.append(Fault(place, sensor.trouble, sensor.hint()))
        elif sensor.given.unit == "degC" and (doubt := wrong_unit(value, temperatures)):
            faults.append(Fault(place, f"{sensor.paths[0]}: {doubt}", "name another sensor, or correct its driver"))
        elif doubt := outside(sensor.given, value):
            faults.append(Fault(place, f"{sensor.paths[0]}: {doubt}", "name the right sensor, or fit the model to it"))
        else:
            others = f", the first of {len(sensor.paths)} by this name" if len(sensor.paths) > 1 else ""
            _print("sensor", f"{sensor.name}, {sensor.paths[0]}: {value:g} {sensor.given.unit}{others}")
            if sensor.given.unit == "degC" and value in SENTINELS_DEGC and _stands_apart(value, temperatures):
                _print("warning", f"{sensor.name} reads {value:g} degC, as sensors do that have no value: see to it")
    if faults:
        raise Refused(settings.sysfs_root, faults)


def _stands_apart(value_degC: float, all_degC: Sequence[float]) -> bool:
    """Whether a temperature is far from the median of several, or all are the same."""
    middle_degC = sorted(all_degC)[len(all_degC) // 2]
    return len(all_degC) > 1 and (abs(value_degC - middle_degC) > _APART_K or len({*all_degC}) == 1)


def check_all(settings: Settings, checks: tuple[Callable[[Settings], None], ...]) -> None:
    """Run all ``checks``; raises :class:`Refused` with the faults of all."""
    refusals = []
    for check in checks:
        try:
            check(settings)
        except Refused as refused:
            refusals.append(refused)
    if len(refusals) == 1:
        raise refusals[0]
    if refusals:
        raise Refused(settings.source, [fault for refused in refusals for fault in refused.faults])


def check_outlets(settings: Settings) -> None:
    """Print what each published file and the state would be; raises :class:`Refused` where one cannot be written.

    A missing folder is only reported: the service manager may create it at start.
    """
    faults = []
    for each in created(settings.publish, settings.state):
        folder = os.path.dirname(each.path) or "."
        if os.path.isdir(folder):
            faults += prove([each], lambda name, text: _print("output", f"{name}: {text}"))
        else:
            _print("output", f"{name_of(each)}: {folder} is not there; it must be when the daemon starts")
    if faults:
        raise Refused(settings.source, faults)


def check_reference(settings: Settings) -> None:
    """Print what the reference file holds now; raises :class:`Refused` where that is no reading.

    A missing file is only reported: the program that writes it may not have begun.
    """
    reference = settings.reference
    if reference is None or not reference.path:
        return
    if not os.path.exists(reference.path):
        _print("reference", f"{reference.path} is not there; nothing is learnt from it until it is")
        return
    try:
        content = read_whole(reference.path, LARGEST_BYTES)
        value, sigma = reference_degC(content, reference.unit, reference.sigma_degC)
    except ValueError as error:
        raise refuse(
            reference.path, "", str(error), f"have it hold 'VALUE' or 'VALUE SIGMA' in {reference.unit}"
        ) from error
    age_s = time.time() - os.stat(reference.path).st_mtime
    _print("reference", f"{reference.path}: {value:g} +- {sigma:g} degC, {age_s:.0f} s old")


def check_consumers(settings: Settings, root: str = "/") -> None:
    """Print which programs here read what is published; raises :class:`Refused` where one must not."""
    found, faults = followed(settings.publish, root)
    for each in found:
        _print("consumer", each)
    if faults:
        raise Refused(settings.source, faults)


def report_sensors(settings: Settings) -> None:
    """As :func:`check_sensors` on a host, where sensors may be missing: they are only reported."""
    try:
        check_sensors(settings)
    except Refused as refused:
        for each in refused.faults:
            _print("sensor", f"{each.place.removeprefix('sensor ').removeprefix('input ')}: {each.problem}")
        _print("", "the model file is right; to run it on this device, name its zones in a configuration")


def _print(subject: str, text: str) -> None:
    print(f"{subject:<12} {text}")
