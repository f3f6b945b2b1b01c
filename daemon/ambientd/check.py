"""``ambientd check``: whether a model file computes here what it must, and whether its sensors are here."""

from ambient_model.codec import load_model
from ambient_model.conformance import TOLERANCE_DEGC, worst_difference_degC
from ambient_model.faults import Fault, Refused, refuse
from ambient_model.model import Model
from ambientd.config import Settings
from ambientd.sources.assign import assigned_sensors, location_of
from ambientd.sources.supervision import outside


def check_files(settings: Settings) -> None:
    """Say what the model is and prove its recursion; raises :class:`Refused` where the file or the proof fails."""
    model = load_model(settings.model)
    _describe(settings, model)
    worst_degC = worst_difference_degC(model)
    if not worst_degC <= TOLERANCE_DEGC:
        raise refuse(
            settings.model,
            "conformance",
            f"this device computes {worst_degC:g} degC beside what the file says, and {TOLERANCE_DEGC:g} is allowed",
            "export the model again with 'ambient-trainer fit'; where it fails again, this Python computes wrong",
        )
    rows = len(model.conformance.inputs)
    _say("conformance", f"passed: {rows} samples at {len(model.main.discrete)} periods, to {worst_degC:g} degC")


def _describe(settings: Settings, model: Model) -> None:
    low, high = model.main.interval[settings.level_percent]
    _say("model", f"{model.name}, created {model.created}")
    for each in model.main.inputs:
        _say("input", f"{each.column}, {each.min:g} to {each.max:g}, {location_of(settings, each)}")
    _say("states", ", ".join(model.main.states) or "none")
    _say("periods", f"{', '.join(f'{each.period_s:g}' for each in model.main.discrete)} s")
    _say("interval", f"{low:+g} to {high:+g} degC around the estimate, {settings.level_percent} %")
    _say("fallbacks", ", ".join(f"without {name}" for name in model.fallbacks) or "none")


def check_sensors(settings: Settings) -> None:
    """Say what each input's sensor reads now; raises :class:`Refused` where one is missing or says nothing of use."""
    faults = []
    for sensor in assigned_sensors(settings, load_model(settings.model)):
        sensor.open()
        value = sensor.read()
        sensor.close()
        place = f"sensor {sensor.name}"
        if value is None:
            faults.append(Fault(place, sensor.trouble, sensor.source.mend()))
        elif doubt := outside(sensor.given, value):
            faults.append(Fault(place, f"{sensor.paths[0]}: {doubt}", "name the right sensor, or fit the model to it"))
        else:
            others = f", the first of {len(sensor.paths)} by this name" if len(sensor.paths) > 1 else ""
            _say("sensor", f"{sensor.name}, {sensor.paths[0]}: {value:g} {sensor.source.unit}{others}")
    if faults:
        raise Refused(settings.sysfs_root, faults)


def say_unneeded(settings: Settings) -> None:
    """As :func:`check_sensors`, where nobody has said that the sensors should be here: what is missing is told only."""
    try:
        check_sensors(settings)
    except Refused as refused:
        for each in refused.faults:
            _say("sensor", f"{each.place.removeprefix('sensor ').removeprefix('input ')}: {each.problem}")
        _say("", "the model file is right; to run it on this device, name its zones in a configuration")


def _say(subject: str, text: str) -> None:
    print(f"{subject:<12} {text}")
