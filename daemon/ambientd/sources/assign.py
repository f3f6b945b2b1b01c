"""Which sensor carries which input: the model names a thermal zone, and a configuration may override it."""

from collections.abc import Callable

from ambient_model.faults import Fault, Refused
from ambient_model.model import Input, Model
from ambientd.settings import Settings
from ambientd.sources.sensor import Sensor
from ambientd.sources.sensors import Sensors
from ambientd.sources.spec import Location
from ambientd.sources.zone import Zone


def open_sensors(
    settings: Settings, model: Model, note: Callable[[str], None], set_alarm: Callable[[float], None]
) -> Sensors:
    """The sensors of the model's inputs, ready to be read; raises :class:`Refused` as :func:`assigned_sensors` does.

    ``note`` and ``set_alarm`` are as :class:`Sensors` takes them.
    """
    return Sensors(assigned_sensors(settings, model), settings.supervision, note, set_alarm, 1 / settings.rate_hz)


def assigned_sensors(settings: Settings, model: Model) -> list[Sensor]:
    """One sensor per input of the model; raises :class:`Refused` for an input that no sensor can give."""
    names = [each.name for each in model.main.inputs]
    faults = [
        Fault(f"{key}.{name}", "is no input of the model", f"its inputs are {', '.join(names)}")
        for key, named in (("zones", settings.zones), ("sensors", settings.sensors))
        for name in named
        if name not in names
    ]
    faults += [
        Fault(
            f"sensors.{each.name}",
            f"{settings.sensors[each.name]} is in {settings.sensors[each.name].unit}, and the input in {each.unit}",
            "name a sensor with the input's unit",
        )
        for each in model.main.inputs
        if each.name in settings.sensors and settings.sensors[each.name].unit != each.unit
    ]
    found = [(each, location_of(settings, each)) for each in model.main.inputs]
    faults += [
        Fault(f"input {each.name}", f"is read from {where}, as {other.name} is", "name one for each")
        for number, (each, where) in enumerate(found)
        for other, same in found[:number]
        if same == where
    ]
    if faults:
        raise Refused(settings.source, faults)
    unread = [
        Fault(f"input {each.name}", f"is in {each.unit}, and thermal zones give only degC", _hint(each))
        for each in model.main.inputs
        if location_of(settings, each).unit != each.unit
    ]
    if unread:
        raise Refused(settings.model, unread)
    return [Sensor(each, location_of(settings, each), settings) for each in model.main.inputs]


def location_of(settings: Settings, given: Input) -> Location:
    """Where ``given`` is read: as configured, else from the model's zone."""
    return settings.sensors.get(given.name) or Zone(settings.zones.get(given.name, given.zone))


def _hint(given: Input) -> str:
    if given.unit in ("A", "V"):
        return f"name a power_supply for it, 'sensors.{given.name}' in a configuration, or fit a model without it"
    return "replay a trace that has it, or fit a model without it"
