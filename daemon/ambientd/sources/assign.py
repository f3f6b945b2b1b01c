"""Which thermal zone carries which input: the model says it, and a configuration may say otherwise."""

from ambient_model.faults import Fault, Refused
from ambient_model.model import Model
from ambientd.config import Settings
from ambientd.sources.zones import ZoneSensor


def assigned_sensors(settings: Settings, model: Model) -> list[ZoneSensor]:
    """One sensor per input of the model; raises :class:`Refused` for an input that no thermal zone can give."""
    names = [each.name for each in model.main.inputs]
    strangers = [
        Fault(f"zones.{name}", "is no input of the model", f"its inputs are {', '.join(names)}")
        for name in settings.zones
        if name not in names
    ]
    if strangers:
        raise Refused(settings.source, strangers)
    others = [
        Fault(
            f"input {each.name}",
            f"is in {each.unit}, and thermal zones give only degC",
            "replay a trace that has it, or fit a model without it",
        )
        for each in model.main.inputs
        if each.unit != "degC"
    ]
    if others:
        raise Refused(settings.model, others)
    return [ZoneSensor(each.name, settings.zones.get(each.name, each.zone)) for each in model.main.inputs]
