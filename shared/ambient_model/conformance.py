"""A port of the recursion is right when it turns the model file's own inputs into the model file's own outputs.

The file holds outputs of the main estimator only, before it is blended. A fallback, and the secondary estimator, is
checked for self-consistency: a step leaves its equilibrium unchanged, the equilibrium's output is the same at every
period, and with constant inputs a long step equals several short ones.
"""

import math
from collections.abc import Sequence

from ambient_model.model import Conformance, Discrete, Estimator, Matrix, Model
from ambient_model.recursion import advance, equilibrium, output

TOLERANCE_DEGC = 1e-9
TOLERANCE = 1e-8
"""For numbers of any unit, beside themselves or beside 1: an ill-conditioned fit has shown 1e-10."""
_MOST_ROWS = 32
_MOST_SHORT_STEPS = 1000


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


def worst_contradictions(model: Model) -> dict[str, float]:
    """Per fallback, named by the input that it does without, the most by which it contradicts itself; see above.

    Relative to the numbers compared, or to 1 where they are smaller; infinite where one is not finite.
    """
    return {name: _worst_contradiction(model, fallback) for name, fallback in model.fallbacks.items()}


def worst_contradiction_of_secondary(model: Model) -> float:
    """The same of the secondary estimator; 0 where there is none."""
    return 0.0 if model.secondary is None else _worst_contradiction(model, model.secondary.estimator)


def _worst_contradiction(model: Model, estimator: Estimator) -> float:
    picks = [model.main.inputs.index(each) for each in estimator.inputs]
    rows = tuple([tuple([row[index] for index in picks]) for row in model.conformance.inputs[:_MOST_ROWS]])
    return max([0.0, *(_contradiction(estimator, before, u) for before, u in zip((rows[-1:] + rows), rows))])


def _contradiction(estimator: Estimator, before: Sequence[float], u: Sequence[float]) -> float:
    """With the inputs ``u``, in their equilibrium and coming from that of ``before``."""
    rest, start = equilibrium(estimator.initial, u), equilibrium(estimator.initial, before)
    first = output(estimator.discrete[0], estimator.offset, rest, u)
    shortest = min(estimator.discrete, key=_period_s)
    worst = 0.0
    x, steps = start, 0
    for discrete in sorted(estimator.discrete, key=_period_s):
        worst = max(
            worst,
            _apart([output(discrete, estimator.offset, rest, u)], [first]),
            _apart(advance(discrete, rest, u), rest),
        )
        ratio = discrete.period_s / shortest.period_s
        if round(ratio) <= _MOST_SHORT_STEPS and abs(ratio - round(ratio)) <= 1e-9 * ratio:
            while steps < round(ratio):
                x, steps = advance(shortest, x, u), steps + 1
            worst = max(worst, _apart(advance(discrete, start, u), x))
    return worst


def _period_s(discrete: Discrete) -> float:
    return discrete.period_s


def _apart(given: Sequence[float], wanted: Sequence[float]) -> float:
    """How far two vectors lie apart, relative to the largest number in the second; infinite where they are not finite.

    Relative to each number would ask of the small ones what rounding of the large ones does not leave.
    """
    scale = max([1.0, *map(abs, wanted)])
    apart = [abs(a - b) / scale for a, b in zip(given, wanted)]
    return max(apart, default=0.0) if all(map(math.isfinite, apart)) else math.inf
