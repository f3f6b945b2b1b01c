"""The thesis's ten models, ready to estimate: fitted, as printed, with the published parameters, and non-causally.

A causal estimate starts from equilibrium with the first sensor sample and never sees the reference.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from ambient_model.trace import REFERENCE
from ambient_studies.thesis.parameters import published_parameters
from ambient_studies.thesis.printed import PRINTED
from ambient_trainer.circuits.assemble import assemble
from ambient_trainer.circuits.schema import load_circuit
from ambient_trainer.data.trace import Array, Trace
from ambient_trainer.estimators.estimate import estimate_degC
from ambient_trainer.estimators.fit import Effort, Fit, fit_circuit
from ambient_trainer.estimators.method import Method
from ambient_trainer.lti.statespace import Hold, StateSpace

MODELS = (
    "model1_kirchhoff",
    "model1_ss",
    "model1_ss_single_input",
    "model2_ss",
    "model2_ss_single_input",
    "model2_ss_free_cd",
    "linear_battery",
    "linear_usb",
    "linear_flash",
    "linear_combined",
)
"""In the order of the thesis's tables."""

NONCAUSAL = "model1_ss_single_input"

EFFORT = Effort(starts=1)
"""One search from the thesis's own initial values, as there.

More starts find deeper optima for model1_ss and model2_ss and leave errors that resemble the published ones less, and
so does fitting in pieces.
"""

Progress = Callable[[str, int, int], None]
"""Told the model that is being fitted, the number of models done and of all."""


def thesis_methods(training: Trace, progress: Progress | None = None) -> list[Method]:
    """Every model in every variant that applies; ``corrected`` and ``noncausal`` are fitted to ``training``.

    Raises :class:`Refused` where ``training`` lacks a sensor or the reference.
    """
    methods = []
    for done, model in enumerate(MODELS):
        if progress is not None:
            progress(model, done, len(MODELS))
        fit = fit_model(model, training)
        methods.append(fitted_method(fit))
        if model == NONCAUSAL:
            methods.append(noncausal_method(fit))
    return [*methods, *map(published_method, MODELS), *map(printed_method, PRINTED)]


def fit_model(model: str, training: Trace) -> Fit:
    """The circuit of that name fitted to ``training`` from equilibrium with its first sample."""
    return fit_circuit(load_circuit(model), [training], EFFORT)


def fitted_method(fit: Fit) -> Method:
    """The corrected equations with the parameters that were found."""
    estimate = _estimate_of(fit.system, fit.hold, fit.inputs)
    return Method(fit.circuit, "corrected", estimate, f"{load_circuit(fit.circuit).about}; fitted to the training run")


def noncausal_method(fit: Fit) -> Method:
    """The same with an offset that is fitted to the reference of the very run under evaluation (erratum 9)."""
    causal = _estimate_of(fit.system, fit.hold, fit.inputs)

    def estimate(trace: Trace) -> Array:
        said = causal(trace)
        return said + np.nanmean(trace.column(REFERENCE) - said)

    return Method(
        fit.circuit, "noncausal", estimate, "as fitted, plus the offset that makes each run's mean error zero"
    )


def published_method(model: str) -> Method:
    """The corrected equations with the parameters of tables 4.1 to 4.8, errata applied; they were found for a phone."""
    circuit, published = load_circuit(model), published_parameters()[model]
    estimate = _estimate_of(assemble(circuit, published.corrected).value, circuit.hold, circuit.inputs)
    about = f"{circuit.about}; parameters of table {published.table}, found on the thesis's phone"
    return Method(model, "published_parameters", estimate, about)


def printed_method(model: str) -> Method:
    """The equations and the parameters as printed, errors included; for the models of ``PRINTED``."""
    printed, published = PRINTED[model], published_parameters()[model]
    estimate = _estimate_of(printed.system(published.printed), "first-order", printed.inputs)
    return Method(model, "as_printed", estimate, f"{printed.about}, parameters of table {published.table} as printed")


def _estimate_of(system: StateSpace, hold: Hold, inputs: Sequence[str]) -> Callable[[Trace], Array]:
    return partial(estimate_degC, system, hold, inputs)
