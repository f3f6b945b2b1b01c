"""Related methods, one module each, found by their place: a module (``ESTIMATOR``) keeps the contract of estimators.

What a paper leaves open is filled in; an estimator's ``about`` says what was given and what was filled in.
"""

from ambient_studies.thesis.methods import Method
from ambient_studies.thesis.related._estimator import RelatedEstimator
from ambient_trainer.data import Trace, plugin, plugin_names


def related_estimators() -> list[RelatedEstimator]:
    """Every related method, by the name of its module."""
    return [plugin(__name__, name).ESTIMATOR for name in plugin_names(__name__)]


def related_methods(training: Trace, idle: Trace) -> list[Method]:
    """Train every related method.

    Parameters
    ----------
    training, idle : Trace
        Runs of scenarios 5 and 1; who evaluates on scenario 1 takes another run of it for ``idle``.

    Returns
    -------
    list of Method
        In the order of :func:`related_estimators`.

    Raises
    ------
    Refused
        Where a trace lacks a column or has too few samples.
    """
    traces = {"5": training, "1": idle}
    methods = []
    for each in related_estimators():
        fit = each.fit([traces[scenario] for scenario in each.trained_on])
        methods.append(Method(each.name, "corrected", fit.estimate_degC, each.about))
    return methods
