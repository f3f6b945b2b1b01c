"""A port of the recursion is right when it turns the model file's own inputs into the model file's own outputs."""

import math

from ambient_model.model import Conformance, Discrete, Estimator, Matrix, Model
from ambient_model.recursion import advance, equilibrium, output

TOLERANCE_DEGC = 1e-9


def run_recursion(estimator: Estimator, discrete: Discrete, inputs: Matrix) -> tuple[float, ...]:
    """The outputs in degC, one per row of ``inputs`` (k x m), from the equilibrium with the first row."""
    x = equilibrium(estimator.initial, inputs[0]) if inputs else []
    outputs = []
    for u in inputs:
        outputs.append(output(discrete, estimator.offset, x, u))
        x = advance(discrete, x, u)
    return tuple(outputs)


def conformance_of(estimator: Estimator, inputs: Matrix) -> Conformance:
    """The conformance vector for ``inputs`` at every period of the estimator."""
    return Conformance(inputs, {each.period_s: run_recursion(estimator, each, inputs) for each in estimator.discrete})


def worst_difference_degC(model: Model) -> float:
    """The largest difference between what the file says must come out and what does; infinite where nothing does."""
    worst = 0.0
    for discrete in model.main.discrete:
        given = run_recursion(model.main, discrete, model.conformance.inputs)
        wanted = model.conformance.outputs[discrete.period_s]
        worst = max([worst, *(abs(a - b) if math.isfinite(a) else math.inf for a, b in zip(given, wanted))])
    return worst
