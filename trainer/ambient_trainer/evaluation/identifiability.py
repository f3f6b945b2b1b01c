"""Tests whether a circuit's parameters are identifiable from its inputs and output, in three ways.

The thesis's (section 5.5): the fitted circuit's own output is fitted again from many starts; another parameter set
with a fit close to 100 % shows that the parameters are not identifiable. It cannot show that they are. Beside it stand
the symmetries of the structure (``sensitivity``), which are exact, and the profile of each parameter, which bounds it
by this trace's noise: how much worse the fit gets when the parameter is held away and all others follow.

With errors of variance sigma^2 that remember m samples, deviance(p) = min over the others of |y - y(p)|^2 / (sigma^2
m). Where it stays below the 95 % quantile of chi^2 with one degree of freedom (3.84) the data do not exclude p. A
profile that never leaves that is flat: the data bound the parameter not at all on that side (Raue et al. 2009).
"""

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats
from threadpoolctl import threadpool_limits

from ambient_model.faults import refuse
from ambient_trainer.circuits.addition import started
from ambient_trainer.circuits.circuit import Circuit
from ambient_trainer.data import Array, Segment, Trace, segments
from ambient_trainer.estimation import CircuitStructure, search
from ambient_trainer.estimation.structure import project
from ambient_trainer.estimators import CircuitEstimator, Effort
from ambient_trainer.evaluation.sensitivity import Sensitivity, parameter_names, sensitivity

Progress = Callable[[str, int, int], None]
"""Called with what is being done, how much of it is done, and how much there is."""

CLOSE_PERCENT = 98.0
"""The thesis counts a fit of 98 % as close to 100 %; its search stops there."""
SAME_PERCENT = 99.99
"""From here on a fit gives the same output; a local optimum stays below it."""
MOVED = 0.1
"""A parameter that is 10 % off is another."""

_LEAST_NOISE_DEGC = 1e-3
_OFF = math.log(3.0)
THRESHOLD = float(stats.chi2.ppf(0.95, 1))

_FIRST = 0.02
_ADDED_FARTHEST = 10.0

Values = dict[str, float]


@dataclass(frozen=True)
class Reestimate:
    """A start's end: how well it explains the circuit's own output, and with what parameters."""

    fit_percent: float
    values: Values
    moved: dict[str, float]
    """By what share each parameter that matters at the truth is off: 0.1 is 10 %."""

    def another(self, least_percent: float = SAME_PERCENT) -> bool:
        """Whether this is another parameter set with a fit of at least so much, by default with the same output."""
        return self.fit_percent >= least_percent and max(self.moved.values(), default=0.0) > MOVED


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


@dataclass(frozen=True)
class Recovery:
    """Parameters found from the circuit's own output with noise, ``replicates`` times, in the units of the circuit.

    ``mean`` and ``standard_error`` (of the mean) are of the logarithm where the parameter is positive: exp of the mean.
    """

    name: str
    truth: float
    mean: float
    standard_errors_off: float
    """The mean's distance from the truth in its standard errors."""


@dataclass(frozen=True)
class Identifiability:
    """What the tests found of ``circuit`` at ``values``, with the noise its fit to the trace has."""

    circuit: str
    trace: str
    values: Values
    held: tuple[str, ...]
    at_bound: tuple[str, ...]
    rmse_degC: float
    correlation_samples: float
    reestimates: tuple[Reestimate, ...]
    sensitivity: Sensitivity
    profiles: tuple[Profile, ...]
    recovered: tuple[Recovery, ...]

    @property
    def others(self) -> tuple[Reestimate, ...]:
        """The other parameter sets with the same output."""
        return tuple(each for each in self.reestimates if each.another())

    @property
    def flat(self) -> tuple[str, ...]:
        """The parameters that the data leave open on a side."""
        return tuple(each.name for each in self.profiles if each.flat)

    @property
    def identifiable(self) -> bool:
        """Whether a perfect trace determines all parameters."""
        return not self.sensitivity.blind_directions


@dataclass(frozen=True)
class Subject:
    """A circuit at its true values over inputs, with its own output in place of the measured one."""

    circuit: Circuit
    values: Values
    own: tuple[Segment, ...]
    noise_degC: float
    correlation_samples: float

    def structure(self, values: Mapping[str, float], held: Collection[str] = ()) -> CircuitStructure:
        """The circuit to be fitted to its own output, as :func:`started` has it."""
        return CircuitStructure(started(self.circuit, values, held), self.own)


def _refitted(structure: CircuitStructure) -> tuple[float, Values]:
    """The sum of squares where a search from the start ends, and the values of all parameters there."""
    best = search(structure, 1, 0).best
    return best.sum_of_squares, structure.values(best.theta, best.beta)


def identifiability(
    circuit: Circuit,
    trace: Trace,
    fixed: Mapping[str, float | None],
    effort: Effort,
    replicates: int = 20,
    progress: Progress = lambda what, done, total: None,
    period_s: float | None = None,
) -> Identifiability:
    """Fit ``circuit`` to ``trace`` and test what is identifiable; ``fixed`` holds parameters.

    A fixed parameter's value is given, or None for the one of the fit. Raises :class:`Refused`.
    """
    known = {each.name: each for each in circuit.parameters if each.free}
    given = {name: value for name, value in fixed.items() if value is not None}
    for name in fixed:
        if name not in known:
            raise refuse("--fix", "", f"{circuit.name} has no free parameter {name!r}", f"it has {', '.join(known)}")
        low, high = known[name].low, known[name].high
        if not low <= given.get(name, low) <= high:
            raise refuse("--fix", name, f"{given[name]:g} lies outside {low:g} to {high:g}", "move its min or max")
    circuit = started(circuit, given, given)
    progress("fitting", 0, effort.starts)
    fit = CircuitEstimator(circuit).fit(
        [trace], effort, lambda start, *_: progress("fitting", start, effort.starts), period_s
    )
    with threadpool_limits(1):
        values = {each.name: each.initial for each in circuit.parameters}
        values.update({each.name: each.value for each in fit.parameters})
        held_there = started(circuit, {name: values[name] for name in fixed}, fixed)
        stretches = segments(trace, circuit.inputs, [output.column for output in circuit.outputs], period_s)
        noise = max(fit.rmse_degC, _LEAST_NOISE_DEGC)
        subject = own_output(held_there, values, stretches, noise, fit.residual_memory_samples)
        structure = subject.structure({})
        theta, beta = unknowns_at(structure, subject.values)
        sensed, profiles = sensitivity(structure, theta, beta, effort.seed), []
        ends, names = reestimates(subject, sensed, effort, progress), parameter_names(structure)
        for index, name in enumerate(names):
            progress("holding each parameter away", index, len(names))
            profiles.append(profile(subject, name))
        return Identifiability(
            circuit=circuit.name,
            trace=trace.path,
            values=subject.values,
            held=tuple(fixed),
            at_bound=tuple(each.name for each in fit.parameters if each.at_bound and each.name not in fixed),
            rmse_degC=fit.rmse_degC,
            correlation_samples=fit.residual_memory_samples,
            reestimates=ends,
            sensitivity=sensed,
            profiles=tuple(profiles),
            recovered=recovered(subject, sensed, replicates, effort.seed, progress),
        )


def own_output(
    circuit: Circuit, values: Values, stretches: Sequence[Segment], noise_degC: float, correlation_samples: float
) -> Subject:
    """``circuit`` at ``values`` with its own output over the inputs of ``stretches``, where these have one."""
    structure = CircuitStructure(circuit, stretches)
    theta, beta = unknowns_at(structure, values)
    own = (structure.predicted(theta, beta, index) + 0 * each.outputs for index, each in enumerate(stretches))
    laid = tuple(replace(each, outputs=outputs) for each, outputs in zip(stretches, own))
    return Subject(circuit, values, laid, noise_degC, correlation_samples)


def unknowns_at(structure: CircuitStructure, values: Values) -> tuple[Array, Array]:
    """theta and beta at ``values``; initial states as they fit best."""
    names, logarithmic = structure.search.names, structure.logarithmic_names
    theta = np.array([math.log(values[name]) if name in logarithmic else values[name] for name in names])
    beta = np.array([values[each.name] for each in structure.linear_parameters])
    if len(structure.linear.names) > len(beta):
        starts = project(structure, theta).beta[len(beta) :]
        beta = np.concatenate([beta, starts])
    return theta, beta


def reestimates(subject: Subject, known: Sensitivity, effort: Effort, progress: Progress) -> tuple[Reestimate, ...]:
    """Fit the circuit's own output from its initial values, and from the truth with each parameter up to threefold off.

    From farther off most searches end in a local optimum, which is no evidence.
    """
    outputs = [row[~np.isnan(row)] for each in subject.own for row in each.outputs]
    about_mean = sum(float(np.var(row)) * len(row) for row in outputs if len(row))
    ends, random = [], np.random.default_rng(effort.seed + 1)
    names = subject.structure({}).logarithmic_names
    for number in range(effort.starts):
        factors = np.exp(random.uniform(-_OFF, _OFF, len(names))) if number else np.ones(0)
        off = {name: subject.values[name] * by for name, by in zip(names, factors.tolist())}
        progress("fitting its own output", number, effort.starts)
        left, values = _refitted(subject.structure(off))
        sensitive = (name for name in known.effect_degC if name not in known.insensitive)
        moved = {name: _moved(subject.values[name], values[name]) for name in sensitive}
        fit_percent = 100.0 * (1.0 - math.sqrt(max(left, 0.0) / about_mean))
        ends.append(Reestimate(fit_percent, {name: values[name] for name in known.effect_degC}, moved))
    return tuple(ends)


def profile(subject: Subject, name: str) -> Profile:
    """The profile of ``name`` around the subject's values, the noise being that of the fit.

    A positive parameter is moved by up to a hundredfold, a weight by ten or ten times itself.
    """
    parameter = next(each for each in subject.circuit.parameters if each.name == name)
    value, unit_deviance = subject.values[name], subject.noise_degC**2 * subject.correlation_samples
    logarithmic = name in subject.structure({}).logarithmic_names
    if logarithmic:
        spans = (math.log(min(100, value / parameter.low)), math.log(min(100, parameter.high / value)))
    else:
        reach = _ADDED_FARTHEST * max(1.0, abs(value))
        spans = (min(reach, value - parameter.low), min(reach, parameter.high - value))
    step = 1.0 if logarithmic else max(abs(value), 0.1)

    def at(offset: float) -> float:
        return value * math.exp(offset) if logarithmic else value + offset

    def side(sign: int, span: float) -> tuple[list[tuple[float, float]], float | None]:
        """Points (value, deviance) in doubling steps to one side up to the threshold, and where they cross it."""
        points: list[tuple[float, float]] = []
        here, before, offset = subject.values, (0.0, 0.0), min(_FIRST * step, span)
        while offset > before[0]:
            x = at(sign * offset)
            left, here = _refitted(subject.structure({**here, name: x}, [name]))
            deviance = left / unit_deviance
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


def recovered(
    subject: Subject, known: Sensitivity, replicates: int, seed: int, progress: Progress
) -> tuple[Recovery, ...]:
    """What comes back, on average, of the identifiable parameters, from the own output with white noise."""
    random = np.random.default_rng(seed)
    structure = subject.structure(subject.values)
    unclear = {*known.mixed, *known.mixed_here, *known.insensitive}
    names = [name for name in parameter_names(structure) if name not in unclear]
    positive = [name in structure.logarithmic_names for name in names]
    draws = []
    for index in range(replicates if names else 0):
        progress("fitting its own output with noise", index, replicates)
        noises = (random.normal(0.0, subject.noise_degC, each.outputs.shape) for each in subject.own)
        noisy = [replace(each, outputs=each.outputs + noise) for each, noise in zip(subject.own, noises)]
        _, values = _refitted(CircuitStructure(structure.circuit, noisy))
        draws.append([math.log(values[name]) if log else values[name] for name, log in zip(names, positive)])
    if len(draws) < 2:
        return ()
    mean, error = np.mean(draws, axis=0), np.std(draws, axis=0, ddof=1) / math.sqrt(len(draws))
    truth = [subject.values[name] for name in names]
    distance = mean - [math.log(value) if log else value for value, log in zip(truth, positive)]
    off = np.divide(distance, error, out=np.zeros(len(names)), where=error > 0)
    middle = [math.exp(value) if log else value for value, log in zip(mean.tolist(), positive)]
    return tuple(map(Recovery, names, truth, middle, off.tolist()))


def _moved(truth: float, found: float) -> float:
    if truth > 0 and found > 0:
        return max(truth / found, found / truth) - 1.0
    return abs(found - truth) / max(abs(truth), MOVED)
