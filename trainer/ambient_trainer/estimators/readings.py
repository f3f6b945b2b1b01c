"""Expected ranges, rates and levels of a device's readings: see :mod:`ambient_model.validation`.

Lags and regularisation of the joint distribution are those with the least differences on blocks that were left out; the
gates are the largest differences there, with a margin.
"""

import operator
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from ambient_model.model import ReadingModel, SensorLimits
from ambient_model.trace import REFERENCE
from ambient_model.validation import SLOW_S
from ambient_trainer.data import Array, Trace, noise_of, resolution_of, segments
from ambient_trainer.estimators.base import Fit, slowest_period_s
from ambient_trainer.estimators.estimate import matrix
from ambient_trainer.lti import discretised, equilibrium, low_pass, response_degC, states

_LAGS_S = ((20.0, 200.0), (60.0, 600.0), (30.0, 200.0, 1200.0), (60.0,), ())
"""From the body of a sensor to the whole device; short logs show fewer."""
_RIDGES = (0.3, 1.0, 3.0, 10.0)
"""Standard deviations of the regularisation, in those of the readings' noise."""
_BLOCKS = 10
_GATE_MARGIN = 1.75
_JUMP_MARGIN = 3.0
_LEAST_TURN_K = 1.0
"""A lie of less costs no more than a doubt, and heat that training lacks may do as much in a second."""
_RATE_MARGIN = 3.0
_OUTPUT_MARGIN_K = 20.0
_MOST_INPUTS = 12
"""A device computes the expectations of more sensors too slowly."""
_SAMPLES_PER_ENTRY = 10
_LEAST_SLOW_S = 4 * SLOW_S
"""Shorter logs do not show how far slow differences go: any that is in its gate may last."""
_UNJUDGED = {"step": 1.0, "jump": 1e9, "still_s": 1e9, "turn": 0.0, "start": 1e9}
"""A power or a switch jumps by nature, and stays: temperatures are expected by it, and it is not judged."""
_STARTS = 4000
_START_OFFSET_DEGC = 0.2
"""Standard deviation of a sensor's own constant error, which a start takes for no difference: an NTC of 1 %, twice."""
_WIDER = 1.2
"""Settled is an interval that is at most so much wider than the usual one."""


@threadpool_limits.wrap(limits=1)
def reading_model(fit: Fit, traces: Sequence[Trace]) -> ReadingModel | None:
    """The distribution of the readings of ``fit`` in its training traces; None where those are too short for one."""
    period_s = slowest_period_s(traces)
    runs = [each.inputs for trace in traces for each in segments(trace, fit.inputs, (), period_s)]
    count, samples = len(fit.inputs), sum(run.shape[1] for run in runs)
    lags = [each for each in _LAGS_S if samples >= _SAMPLES_PER_ENTRY * count * (1 + len(each))]
    if fit.outputs != ("ambient",) or count > _MOST_INPUTS or not lags:
        return None
    # the standard deviation of each reading's white noise; at least a 1000th of its own
    least = np.maximum(1e-3 * np.concatenate(runs, axis=1).std(axis=1), 1e-3)
    noise = np.maximum([noise_of(rows) for rows in zip(*runs)], least)
    # one after the other: each holds all samples, several times
    tried = ((each.loss(r * noise), r, each) for each in (_Folds(runs, period_s, lag) for lag in lags) for r in _RIDGES)
    _, ridge, chosen = min(tried, key=operator.itemgetter(0))
    held_out = list(chosen.differences(ridge * noise))
    mean, precision = _distribution(chosen.total, ridge * noise)
    stride = max(1, min(round(1.0 / period_s), max(run.shape[1] for run in runs) // 2))
    slowly = [low_pass(each, SLOW_S, period_s, 0.0) for each in held_out]
    gate, slow = (_GATE_MARGIN * np.max([np.abs(d).max(axis=0) for d in each], axis=0) for each in (held_out, slowly))
    slow = slow if samples * period_s >= _LEAST_SLOW_S else gate
    changes = [np.abs(run[:, stride:] - run[:, :-stride]).max(axis=1, initial=0.0) for run in runs]
    jump = _JUMP_MARGIN * np.max(changes, axis=0)
    estimates = [response_degC(fit.system, fit.hold, run, period_s) for run in runs]
    reference = np.concatenate([trace.column(REFERENCE) for trace in traces])
    rate = max(np.abs(each[stride:] - each[:-stride]).max(initial=0.0) for each in estimates) / (stride * period_s)
    degC = np.array([each.endswith("_degC") for each in fit.inputs])
    off = _START_OFFSET_DEGC * degC
    both = [fit, *([fit.secondary.fit] if fit.secondary else [])]
    starts = [_expected_start(each, runs, period_s, np.hypot(ridge * noise, off), degC) for each in both]
    at_rest = [np.column_stack([np.ones(run.shape[1]), np.tile(run.T, 1 + len(chosen.lags_s))]) for run in runs]
    apart = np.concatenate([_differences(each, count, mean, precision) for each in at_rest])
    sensors = zip(
        [resolution_of(np.concatenate(rows)) for rows in zip(*runs)],
        *(each.tolist() for each in (jump, gate, slow)),
        [_still_s(rows, period_s) for rows in zip(*runs)],
        _memory_s(held_out, period_s).tolist(),
        [_effect_degC(fit, runs, estimates, period_s, index) for index in range(count)],
        _turns_K(chosen.tables, count, stride, mean, precision),
        np.abs(apart).max(axis=0).tolist(),
    )
    return ReadingModel(
        lags_s=chosen.lags_s,
        mean=tuple(mean.tolist()),
        precision=matrix(precision),
        sensors=tuple(SensorLimits(*each)._replace(**({} if own else _UNJUDGED)) for own, each in zip(degC, sensors)),
        jump_s=stride * period_s,
        settled_s=_settled_s(fit, runs, period_s, starts[0]),
        output=(float(np.nanmin(reference)) - _OUTPUT_MARGIN_K, float(np.nanmax(reference)) + _OUTPUT_MARGIN_K),
        rate_K_per_s=float(_RATE_MARGIN * rate),
        starts=tuple(map(matrix, starts)),
        offset_gains=matrix(_offset_gains(np.concatenate(slowly), precision, off)) if count > 1 else (),
        offset_std_degC=max(_START_OFFSET_DEGC, float(np.linalg.norm(off * fit.dc_gains))),
    )


class _Folds:
    """One, the readings of all runs, and their low-pass filters up to the sample before, in successive blocks of time.

    ``total`` are the inner products of these (entries + 1) columns, from which those of a block are left out.
    """

    def __init__(self, runs: Sequence[Array], period_s: float, lags_s: tuple[float, ...]) -> None:
        self.lags_s = lags_s
        tables = []
        for run in runs:
            before = np.concatenate([run.T[:1], run.T[:-1]])
            lows = [low_pass(before, lag_s, period_s, run[:, 0]) for lag_s in lags_s]
            tables.append(np.column_stack([np.ones(len(before)), run.T, *lows]))
        joint = np.concatenate(tables)
        self.tables = np.split(joint, np.cumsum([len(each) for each in tables])[:-1])
        """Per run."""
        self.total, self.blocks = joint.T @ joint, np.array_split(joint, _BLOCKS)
        self._own = [block.T @ block for block in self.blocks]

    def differences(self, deviations: Array) -> Iterator[Array]:
        """Differences (N, m) of each block's readings to what the other blocks make expect."""
        count = len(deviations)
        for block, own in zip(self.blocks, self._own):
            yield _differences(block, count, *_distribution(self.total - own, deviations))

    def loss(self, deviations: Array) -> float:
        """The sum of the logarithms of the readings' mean squares."""
        squares = np.concatenate(list(self.differences(deviations))) ** 2
        return float(np.log(squares.mean(axis=0) + 1e-12).sum())


def _distribution(gram: Array, deviations: Array) -> tuple[Array, Array]:
    """Mean and precision from inner products, regularised by white noise of these deviations on each reading."""
    mean, second = gram[0, 1:] / gram[0, 0], gram[1:, 1:] / gram[0, 0]
    repeated = np.tile(deviations, len(mean) // len(deviations))
    precision = np.linalg.inv(second - np.outer(mean, mean) + np.diag(repeated**2))
    return mean, (precision + precision.T) / 2


def _weights(precision: Array, count: int) -> Array:
    """Weights (m, M) of the expectation of each reading given all that is not of its own."""
    own = np.arange(len(precision)) % count == np.arange(count)[:, None]
    weights = [-np.linalg.inv(precision[np.ix_(each, each)])[0] @ precision[each] for each in own]
    return np.where(own, 0.0, weights)


def _differences(table: Array, count: int, mean: Array, precision: Array) -> Array:
    """Differences (N, m) of the readings of a table to what the distribution makes expect."""
    centred = table[:, 1:] - mean
    return np.asarray(centred[:, :count] - centred @ _weights(precision, count).T)


def _offset_gains(slow: Array, precision: Array, off: Array) -> Array:
    """The regression (m, m) of constant errors, whose deviations are ``off`` (m,), on slow differences, which without
    them vary as ``slow`` (N, m)."""
    count = slow.shape[1]
    expected = _weights(precision, count).reshape(count, -1, count).sum(axis=1)
    effect = (np.eye(count) - expected) * off
    return np.asarray(off[:, None] * effect.T @ np.linalg.inv(effect @ effect.T + slow.T @ slow / len(slow)))


def _turns_K(tables: Sequence[Array], count: int, stride: int, mean: Array, precision: Array) -> list[float]:
    """By how much each difference may change within ``stride`` samples while no other sensor moves; 0 of a single one.

    That is beyond the movement of the other that moved most.
    """
    if count == 1:
        return [0.0]
    largest = np.full(count, _LEAST_TURN_K / _JUMP_MARGIN)
    for table in tables:
        z, d = table[:, 1:], _differences(table, count, mean, precision)
        changed, moved = (np.abs(each[stride:] - each[:-stride]) for each in (d, z))
        for i in range(count):
            others = np.arange(z.shape[1]) % count != i
            beyond = changed[:, i] - moved[:, others].max(axis=1)
            largest[i] = max(largest[i], beyond.max(initial=0.0))
    return [float(each) for each in _JUMP_MARGIN * largest]


def _memory_s(differences: Sequence[Array], period_s: float) -> Array:
    """Time constant of each difference, from its autocorrelation after 30 and 60 s (or a period and two, where that is
    longer; or less, as far as blocks of a short log reach)."""
    near = max(1, min(round(30.0 / period_s), (max(map(len, differences)) - 1) // 2))
    products = [
        np.sum([(each[lag:] * each[: len(each) - lag]).sum(axis=0) for each in differences if len(each) > lag], axis=0)
        for lag in (near, 2 * near)
    ]
    ratio = np.clip(products[1] / np.where(products[0] > 0, products[0], np.inf), 0.05, 0.99)
    return np.asarray(-near * period_s / np.log(ratio))


def _still_s(rows: Sequence[Array], period_s: float) -> float:
    """The longest time for which a reading is the same; at least 20 s."""
    changes = [np.concatenate([[0], np.flatnonzero(np.diff(row)), [len(row)]]) for row in rows]
    return float(max(20.0, max(np.diff(each).max() for each in changes) * period_s))


def _effect_degC(fit: Fit, runs: Sequence[Array], estimates: Sequence[Array], period_s: float, index: int) -> float:
    """Standard deviation of the estimate's change where one sensor alone reports whole degrees."""
    changes = []
    for run, estimate in zip(runs, estimates):
        rounded = run.copy()
        rounded[index] = np.round(rounded[index])
        changes.append(response_degC(fit.system, fit.hold, rounded, period_s) - estimate)
    return float(np.sqrt(np.mean(np.concatenate(changes) ** 2)))


def _expected_start(
    fit: Fit, runs: Sequence[Array], period_s: float, deviations: Array, degC: NDArray[np.bool_]
) -> Array:
    """The state X u (n, m) that is expected where the first readings are u, of which ``degC`` (m,) are temperatures.

    Where all sensors read the same it is the equilibrium, at any level; from there it goes by their differences, as
    regressed on them over ``runs`` with errors of these ``deviations`` added.
    """
    centring = np.eye(len(deviations)) - np.outer(degC, degC) / max(degC.sum(), 1)
    differences = centring @ np.concatenate(runs, axis=1)
    noise = centring @ np.diag(deviations**2) @ centring
    inverse = np.linalg.pinv(differences @ differences.T / differences.shape[1] + noise, hermitian=True)
    rest = equilibrium(fit.system)
    return rest - _apart(fit, runs, period_s, rest) @ differences.T @ inverse / differences.shape[1]


def _apart(fit: Fit, runs: Sequence[Array], period_s: float, start: Array) -> Array:
    """By how much a start with each sample of ``runs`` differs from the state that the filter has there, (n, N)."""
    discrete, rest = discretised(fit.system, period_s, fit.hold), equilibrium(fit.system)
    return np.concatenate(
        [start @ run - states(discrete.A, discrete.B @ run, rest @ run[:, 0]) for run in runs], axis=1
    )


def _settled_s(fit: Fit, runs: Sequence[Array], period_s: float, start: Array) -> float:
    """Time after which a cold start no longer widens the interval by more than 20 %.

    A start at any training sample errs by d, and after k periods the estimate by C A^k d more than its usual error.
    """
    discrete = discretised(fit.system, period_s, fit.hold)
    apart = _apart(fit, runs, period_s, start)
    random = np.random.default_rng(0)
    starts = apart[:, random.integers(apart.shape[1], size=_STARTS)]
    errors = random.choice(fit.errors_degC[0], _STARTS)
    usual = np.percentile(np.abs(errors), 90)
    settled = 0
    after = np.unique(np.geomspace(1, max(run.shape[1] for run in runs), 200).astype(int))
    for k in (int(each) for each in after):
        effect = (discrete.C[:1] @ np.linalg.matrix_power(discrete.A, k) @ starts)[0]
        if np.percentile(np.abs(errors + effect), 90) > _WIDER * usual:
            settled = k + 1
    return settled * period_s
