"""Profile likelihoods: how much worse the fit gets when one parameter is held away and all others follow.

With errors of variance sigma^2 that remember m samples, deviance(p) = min over the others of |y - y(p)|^2 / (sigma^2
m). Where it stays below the 95 % quantile of chi^2 with one degree of freedom (3.84) the data do not exclude p. A
profile that never leaves that is flat: the data bound the parameter not at all on that side (Raue et al. 2009).
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

from scipy import stats

from ambient_trainer.circuits.circuit import Circuit
from ambient_trainer.estimation.circuit_structure import CircuitStructure
from ambient_trainer.estimation.search import search

Values = dict[str, float]

THRESHOLD = float(stats.chi2.ppf(0.95, 1))

_FIRST = 0.02
_ADDED_FARTHEST = 10.0


@dataclass(frozen=True)
class Profile:
    """The deviance of a parameter held at ``values``, ascending, and its 95 % interval: None where a side is flat."""

    name: str
    value: float
    values: tuple[float, ...]
    deviances: tuple[float | None, ...]
    """None where the circuit cannot be simulated."""
    interval95: tuple[float | None, float | None]

    @property
    def flat(self) -> bool:
        """Whether the data leave a side open."""
        return None in self.interval95


def starting_at(circuit: Circuit, values: Values) -> Circuit:
    """``circuit`` with these initial values, within its bounds."""
    parameters = (
        replace(each, initial=min(max(values.get(each.name, each.initial), each.low), each.high))
        for each in circuit.parameters
    )
    return replace(circuit, parameters=tuple(parameters))


def held(circuit: Circuit, values: Values) -> Circuit:
    """``circuit`` with the named parameters held at these values."""
    started = starting_at(circuit, values).parameters
    parameters = (replace(each, free=each.free and each.name not in values) for each in started)
    return replace(circuit, parameters=tuple(parameters))


def profile(
    structure_of: Callable[[Circuit], CircuitStructure],
    circuit: Circuit,
    values: Values,
    name: str,
    unit_deviance: float,
) -> Profile:
    """The profile of ``name`` around ``values``, where the fit to the structure's outputs is perfect.

    ``unit_deviance`` is the sum of squares in degC^2 that counts as one. A positive parameter is moved by up to a
    hundredfold, a weight by ten or ten times itself.
    """
    parameter = next(each for each in circuit.parameters if each.name == name)
    value = values[name]
    logarithmic = name in structure_of(circuit).logarithmic_names
    if logarithmic:
        spans = (math.log(min(100, value / parameter.low)), math.log(min(100, parameter.high / value)))
    else:
        reach = _ADDED_FARTHEST * max(1.0, abs(value))
        spans = (min(reach, value - parameter.low), min(reach, parameter.high - value))
    step = 1.0 if logarithmic else max(abs(value), 0.1)

    def at(offset: float) -> float:
        return value * math.exp(offset) if logarithmic else value + offset

    def refit(x: float, start: Values) -> tuple[float, Values]:
        """The deviance with ``name`` at ``x``, and the values of the others there."""
        structure = structure_of(held(starting_at(circuit, start), {name: x}))
        best = search(structure, 1, 0).best
        return best.sum_of_squares / unit_deviance, structure.values(best.theta, best.beta)

    def side(sign: int, span: float) -> tuple[list[tuple[float, float]], float | None]:
        """Points (value, deviance) in doubling steps to one side up to the threshold, and where they cross it."""
        points: list[tuple[float, float]] = []
        here, before, offset = values, (0.0, 0.0), min(_FIRST * step, span)
        while offset > before[0]:
            x = at(sign * offset)
            deviance, here = refit(x, here)
            points.append((x, deviance))
            root = math.sqrt(max(deviance, 0.0))
            if deviance > THRESHOLD:
                # near its least the root of the deviance is a straight line
                share = (math.sqrt(THRESHOLD) - before[1]) / (root - before[1])
                return points, at(sign * (before[0] + share * (offset - before[0])))
            before, offset = (offset, root), min(2 * offset, span)
        return points, None

    (below, low), (above, high) = side(-1, spans[0]), side(1, spans[1])
    points = [*reversed(below), (value, 0.0), *above]
    deviances = tuple(deviance if math.isfinite(deviance) else None for _, deviance in points)
    return Profile(name, value, tuple(x for x, _ in points), deviances, (low, high))
