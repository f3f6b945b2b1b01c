"""Related methods, one module each, found by their place: each names its ``METHOD``.

What a paper leaves open is filled in; a method's ``about`` says what was given and what was filled in.
"""

from ambient_studies.thesis.methods import Method
from ambient_studies.thesis.related._samples import Related
from ambient_trainer.data import Trace, plugin, plugin_names


def related() -> list[Related]:
    """Every related method, by the name of its module."""
    return [plugin(__name__, name).METHOD for name in plugin_names(__name__)]


def related_methods(training: Trace, idle: Trace) -> list[Method]:
    """Train every related method on runs of scenarios 5 and 1, in the order of :func:`related`.

    Who evaluates on scenario 1 takes another run of it for ``idle``. Raises :class:`Refused` where a trace lacks a
    column or has too few samples.
    """
    traces = {"5": training, "1": idle}
    return [
        Method(each.name, "corrected", each.trained(*(traces[name] for name in each.trained_on)), each.about)
        for each in related()
    ]
