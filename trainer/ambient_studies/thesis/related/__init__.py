"""Related methods, one module each, found by their place: a module has NAME, ABOUT, TRAINED_ON and ``fit``.

What a paper leaves open is filled in; ABOUT says what was given and what was filled in.
"""

from __future__ import annotations

from ambient_studies.thesis.methods import Method
from ambient_trainer.data.plugins import plugin, plugin_names
from ambient_trainer.data.trace import Trace


def related_methods(training: Trace, idle: Trace) -> list[Method]:
    """Train every related method.

    Parameters
    ----------
    training, idle : Trace
        Runs of scenarios 5 and 1; who evaluates on scenario 1 takes another run of it for ``idle``.

    Returns
    -------
    list of Method
        In the order of the modules' names.

    Raises
    ------
    Refused
        Where a trace lacks a column or has too few samples.
    """
    traces = {"5": training, "1": idle}
    methods = []
    for name in plugin_names(__name__):
        module = plugin(__name__, name)
        estimator = module.fit([traces[scenario] for scenario in module.TRAINED_ON])
        methods.append(Method(module.NAME, "corrected", estimator.estimate, module.ABOUT))
    return methods
