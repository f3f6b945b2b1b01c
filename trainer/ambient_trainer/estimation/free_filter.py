"""Free linear filter, the black-box benchmark: its poles are searched, and every gain is solved for.

    y = d' u + offset + sum_i b_i(s)' u / p_i(s)

over first-order sections p = s + r and second-order ones p = s^2 + 2 zeta omega s + omega^2, which hold two real
poles (zeta > 1), a double one or a damped pair alike.

It may be fitted to runs that do not all count the same: logged, simulated, or made of what physics demands. All
sensors one degree up is the estimate one degree up; what is left of an impulse of one sensor is its noise gain; what is
left of a constant offset of one is its DC gain, which a short log of few levels leaves open.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.linalg import block_diag, expm
from scipy.signal import lfilter

from ambient_trainer.data import Array, Segment
from ambient_trainer.estimation.structure import Structure, Unknowns
from ambient_trainer.lti import StateSpace, discretised

_FASTEST_PER_PERIOD = 2.0
_TIMES_SHOWN = 10
_LEAST_DAMPING, _MOST_DAMPING = 0.3, 30.0
_PAIRINGS = {3: ((0, 1, 2), (1, 2, 0), (0, 2, 1)), 4: ((0, 1, 2, 3), (0, 2, 1, 3), (0, 3, 1, 2))}
"""The ways to take three or four things two by two, the last of three alone."""
_STEADY = 8
"""Samples of a run at a constant level: as many as a filter's delays need."""
_IMPULSE = 300
"""Samples of an impulse response; what comes later is small and slow."""


class FreeFilter(Structure):
    """The free linear filter of order N from all inputs to one output, over segments of one period.

    theta is log r or (log omega, log zeta) a section, in 1/s; ``ones`` multiplies the offset in each segment.
    """

    slowest: float
    """Logarithm of the rate below which a pole is penalised."""

    def __init__(self, order: int, segments: Sequence[Segment], ones: Sequence[float] | None = None) -> None:
        self.order, self.segments = order, segments
        self._ones = ones or [1.0] * len(segments)
        self.period_s, self.inputs = segments[0].period_s, segments[0].inputs.shape[0]
        self.pairs, self.singles = divmod(order, 2)
        longest_s = max(segment.inputs.shape[1] for segment in segments) * self.period_s
        self._fastest = math.log(_FASTEST_PER_PERIOD / self.period_s)
        self.slowest = min(math.log(_TIMES_SHOWN / longest_s), self._fastest - 1.0)
        names = [f"{name}{k + 1}" for k in range(self.pairs) for name in ("omega", "zeta")] + ["rate"] * self.singles
        rate, damping = (self.slowest, self._fastest), (math.log(_LEAST_DAMPING), math.log(_MOST_DAMPING))
        low, high = np.array([rate, damping] * self.pairs + [rate] * self.singles).reshape(-1, 2).T
        # rates distributed over what the trace can show
        start = self._from_rates(np.exp(np.linspace(*rate, order + 2)[1:-1]))
        self.search = Unknowns(tuple(names), np.clip(start, low, high), low, high)
        self._last: tuple[bytes, list[tuple[Array, Array]]] = b"", []
        p = self.inputs * (1 + order) + 1
        free = np.full(p, np.inf)
        self.linear = Unknowns(tuple(f"gain{index}" for index in range(p)), np.zeros(p), -free, free)

    def _from_rates(self, rates: Array) -> Array:
        """The theta of real poles at -rates, taken two by two."""
        paired = len(rates) // 2 * 2
        theta: list[float] = []
        for a, b in zip(rates[:paired:2], rates[1:paired:2]):
            theta += [0.5 * math.log(a * b), math.log((a + b) / 2 / math.sqrt(a * b))]
        return np.array(theta + [math.log(rate) for rate in rates[paired:]])

    def penalty(self, theta: Array) -> tuple[Array, Array]:
        """Per section, the logarithm by which its slowest pole is slower than what the data show ten times."""
        penalty, slope = np.zeros(self.pairs), np.zeros((self.pairs, len(theta)))
        for k in range(self.pairs):
            omega, zeta = np.exp(theta[2 * k : 2 * k + 2])
            root = math.sqrt(max(zeta**2 - 1, 0.0))
            beyond = self.slowest - math.log(omega * (zeta - root))
            if beyond > 0:
                penalty[k] = beyond
                slope[k, 2 * k : 2 * k + 2] = -1.0, zeta / root if root > 0 else -1.0
        return penalty, slope

    def regrouped(self, theta: Array) -> Array:
        """The same filter with its real poles paired anew, the closest two together.

        Two poles that meet in different sections make gains without limit; in one section they are a double pole.
        """
        poles = [np.linalg.eigvals(F) for F, _ in self._sections(theta)]
        free = [k for k, each in enumerate(poles) if not np.iscomplex(each).any()]
        rates = np.sort(np.concatenate([np.zeros(0), *(-poles[k].real for k in free)]))
        if len(rates) < 3:
            return theta
        found = theta.copy()
        positions = np.concatenate([np.arange(2 * k, min(2 * k + 2, self.order)) for k in free])
        found[positions] = self._from_rates(min((rates[list(each)] for each in _PAIRINGS[len(rates)]), key=_span))
        return np.clip(found, self.search.low, self.search.high)

    def random_start(self, random: np.random.Generator) -> Array:
        """Real poles with rates drawn log-uniformly over what the trace can show."""
        rates = np.exp(np.sort(random.uniform(self.slowest, self._fastest, self.order)))
        return np.clip(self._from_rates(rates), self.search.low, self.search.high)

    def _sections(self, theta: Array) -> list[tuple[Array, Array]]:
        """Per section the companion matrix F (k, k) and its slopes in its own theta (k, k, k)."""
        found = []
        for omega, zeta in np.exp(theta[: 2 * self.pairs]).reshape(-1, 2):
            F = np.array([[0.0, 1.0], [-(omega**2), -2 * zeta * omega]])
            found.append((F, np.array([F * [[0], [1]] * [2, 1], F * [[0], [1]] * [0, 1]])))
        if self.singles:
            F = -np.exp(theta[-1:, None])
            found.append((F, F[None]))
        return found

    def _denominators(self, theta: Array) -> list[tuple[Array, Array]]:
        """Per section the discrete denominator's coefficients after 1 (k,), and their slopes (k in theta, k).

        With E = exp(F T) they are -tr E and det E, and d tr E = T tr(E dF). Those of the last theta are kept.
        """
        if self._last[0] != theta.tobytes():
            found = []
            for F, slopes in self._sections(theta):
                E, T = expm(F * self.period_s), self.period_s
                det = math.exp(T * np.trace(F))
                moved = [(-T * np.trace(E @ each), det * T * np.trace(each)) for each in slopes]
                found.append((np.array([-np.trace(E), det])[: len(F)], np.array(moved)[:, : len(F)]))
            self._last = theta.tobytes(), found
        return self._last[1]

    def regressors(self, theta: Array, index: int) -> tuple[Array, Array]:
        """The inputs, one, and per section the delayed inputs over p."""
        u = self.segments[index].inputs
        rows = [u, np.full((1, u.shape[1]), self._ones[index])]
        for tail, _ in self._denominators(theta):
            once = _over(tail, u)
            rows += [_delayed(once, 1 + delay) for delay in range(len(tail))]
        return np.zeros((1, u.shape[1])), np.concatenate(rows)[:, None]

    def slopes(self, theta: Array, beta: Array, index: int) -> Array:
        """Per section v/p, whose slope is minus d(denominator) times the delayed v over p^2."""
        u, found = self.segments[index].inputs, []
        for (tail, slopes), numerators in zip(self._denominators(theta), self._numerators(beta)):
            section = np.sum([_delayed(row[None], 1 + delay) for delay, row in enumerate(numerators @ u)], axis=0)
            twice = _over(tail, _over(tail, section))
            found.append(-slopes @ np.concatenate([_delayed(twice, 1 + delay) for delay in range(len(tail))]))
        return np.concatenate([np.zeros((0, u.shape[1])), *found])[:, None]

    def _numerators(self, beta: Array) -> list[Array]:
        """Per section the weights (k, m) of the inputs, by delay."""
        rows = beta[self.inputs + 1 :].reshape(-1, self.inputs)
        return np.split(rows, range(2, len(rows), 2)) if len(rows) else []

    def system(self, theta: Array, beta: Array) -> StateSpace:
        """The continuous state space with the same discrete transfer function under a first-order hold.

        Per section, observer form with C = [1, 0, ...]: B follows from the first k Markov parameters.
        """
        m = self.inputs
        D = beta[None, :m].copy()
        A, Bs, Cs = [np.zeros((0, 0))], [np.zeros((0, m))], [np.zeros((1, 0))]
        denominators, numerators = self._denominators(theta), self._numerators(beta)
        for (F, _), (tail, _), markov in zip(self._sections(theta), denominators, numerators):
            k = len(tail)
            C, unit = np.eye(1, k), np.eye(k)
            probe = discretised(StateSpace(F, unit, C, np.zeros((1, k)), np.zeros(1)), self.period_s, "first-order")
            impulse = np.vstack([probe.C @ np.linalg.matrix_power(probe.A, i) @ probe.B for i in range(k)])
            B = np.linalg.solve(impulse, markov - np.eye(k, k=-1) @ markov * tail[0])
            D -= probe.D @ B
            A, Bs, Cs = [*A, F], [*Bs, B], [*Cs, C]
        return StateSpace(block_diag(*A), np.vstack(Bs), np.hstack(Cs), D, beta[m : m + 1].copy())


def _span(rates: Array) -> float:
    """How far apart the closest pair lies, as a logarithm; between ties, how far all of them do."""
    ratios = sorted(abs(math.log(a / b)) for a, b in zip(rates[0:-1:2], rates[1::2]))
    return ratios[0] + 1e-3 * sum(ratios)


def _over(tail: Array, rows: Array) -> Array:
    """rows / (1 + tail_1 z^-1 + tail_2 z^-2), started in equilibrium with the first sample."""
    a = np.concatenate([[1.0], tail])
    return np.asarray(lfilter([1.0], a, rows - rows[:, :1], axis=-1) + rows[:, :1] / a.sum())


def _delayed(rows: Array, steps: int) -> Array:
    """The rows ``steps`` samples later, their first value standing for what came before."""
    return np.concatenate([np.repeat(rows[:, :1], steps, axis=1), rows[:, :-steps]], axis=1)[:, : rows.shape[1]]


class WeightedRun(NamedTuple):
    """A run, what it counts (the root of the weight of a squared error), and whether the filter's offset is in it."""

    segment: Segment
    weight: float
    absolute: bool


def weighted_filter(
    order: int, runs: Sequence[WeightedRun], unit_gain: float, noise: float, offset: float = 0.0
) -> FreeFilter:
    """The free filter of order N over weighted runs, and the weights of what physics demands, as those of a run."""
    period_s, inputs = runs[0].segment.period_s, len(runs[0].segment.inputs)
    target = np.where(np.arange(_STEADY) > 0, np.nan, 1.0)
    demands = [WeightedRun(Segment(period_s, np.ones((inputs, _STEADY)), target[None]), unit_gain, False)]
    # the first sample sets the equilibrium
    impulse = np.append(0.0, np.eye(1, min(_IMPULSE, max(each.segment.inputs.shape[1] for each in runs)) - 1))
    for values, weight in ((impulse, noise), (np.ones(_STEADY), offset / np.sqrt(_STEADY))):
        alone = np.eye(inputs)[:, :, None] * values
        nothing = np.zeros((1, len(values)))
        demands += [WeightedRun(Segment(period_s, u, nothing), weight, False) for u in alone if weight]
    every = [*runs, *demands]
    segments = [Segment(period_s, weight * s.inputs, weight * s.outputs) for s, weight, _ in every]
    return FreeFilter(order, segments, [each.weight * each.absolute for each in every])
