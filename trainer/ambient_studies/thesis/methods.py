"""The thesis's models and our two observers, trained: as corrected, as printed, with published parameters, non-causal.

A causal estimate starts from equilibrium with the first sensor sample and never uses the reference.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Literal

import numpy as np

from ambient_model.trace import REFERENCE
from ambient_studies import Progress
from ambient_studies.thesis.printed import printed_models
from ambient_studies.thesis.published import MODELS, NONCAUSAL, published_parameters
from ambient_trainer.circuits import assemble, load_circuit
from ambient_trainer.data import Array, Trace, sampling_period_s
from ambient_trainer.estimators import Effort, Fit, estimate_degC, estimator

Variant = Literal["corrected", "as_printed", "noncausal", "published_parameters", "ours"]

EFFORT = Effort(starts=1)
"""One search from the thesis's own initial values, as there.

More starts find deeper optima for model1_ss and model2_ss and leave errors that resemble the published ones less, and
so does fitting in pieces.
"""

_OBSERVERS = {
    "circuit_observer": "the nodes that the sensors read, each exchanging heat with the ambient, a random walk",
    "free_observer": "a free linear filter whose DC gains add up to one, its order selected on the training run",
}
_OBSERVED = ("soc_degC", "flash_degC", "battery_degC", "usb_degC", "display_degC")
_OBSERVER_PERIOD_S = 5.0
"""No time constant of a phone's sensors is shorter; it makes the fits of the observers faster."""


@dataclass(frozen=True)
class Method:
    """A trained method under the name it has in the tables.

    ``estimate`` gives the ambient in degC, shape (n,), NaN where it has none, from the sensors of a trace; only the
    variant ``noncausal`` uses the reference. ``about`` says in a line what the method is.
    """

    name: str
    variant: Variant
    estimate: Callable[[Trace], Array]
    about: str


def thesis_methods(training: Trace, progress: Progress) -> list[Method]:
    """Train every model of the thesis in every variant that applies.

    Parameters
    ----------
    training : Trace
        The run to which ``corrected`` and ``noncausal`` are fitted.
    progress : callable
        Called before each fit.

    Returns
    -------
    list of Method
        The variants ``corrected`` (ten), ``noncausal`` (one), ``published_parameters`` (ten), ``as_printed`` (six).

    Raises
    ------
    Refused
        Where ``training`` lacks a sensor or the reference.
    """
    methods = []
    for done, model in enumerate(MODELS):
        progress(f"fitting {model}", done, len(MODELS))
        fit = fit_model(model, training)
        about = f"{load_circuit(model).about}; fitted to the training run"
        methods.append(Method(model, "corrected", fit.estimate_degC, about))
        if model == NONCAUSAL:
            about = "as fitted, plus the offset that makes each run's mean error zero"
            methods.append(Method(model, "noncausal", partial(_without_mean_error, fit), about))
    for model in MODELS:
        circuit, published = load_circuit(model), published_parameters()[model]
        estimate = partial(estimate_degC, assemble(circuit, published.corrected).value, circuit.hold, circuit.inputs)
        about = f"{circuit.about}; parameters of table {published.table}, found on the thesis's phone"
        methods.append(Method(model, "published_parameters", estimate, about))
    for model, printed in printed_models().items():
        estimate = partial(estimate_degC, printed.system, "first-order", printed.inputs)
        about = f"{printed.about}, parameters of table {published_parameters()[model].table} as printed"
        methods.append(Method(model, "as_printed", estimate, about))
    return methods


def observer_methods(training: Trace, progress: Progress) -> list[Method]:
    """``circuit_observer`` and ``free_observer``, fitted to ``training`` over the thesis's five sensors."""
    period_s = max(_OBSERVER_PERIOD_S, sampling_period_s(training.time_s))
    methods = []
    for done, (name, about) in enumerate(_OBSERVERS.items()):
        progress(f"fitting {name}", done, len(_OBSERVERS))
        fit = estimator(name).fit([training], EFFORT, None, period_s, _OBSERVED)
        methods.append(Method(name, "ours", fit.estimate_degC, about))
    return methods


def fit_model(model: str, training: Trace) -> Fit:
    """The circuit of that name fitted to ``training`` from equilibrium with its first sample."""
    return estimator(model).fit([training], EFFORT)


def _without_mean_error(fit: Fit, trace: Trace) -> Array:
    """With an offset that is fitted to the reference of the very run under evaluation (erratum 9)."""
    found = fit.estimate_degC(trace)
    return found + np.nanmean(trace.column(REFERENCE) - found)
