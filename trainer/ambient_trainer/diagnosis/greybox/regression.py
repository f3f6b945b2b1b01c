"""Output-error estimation of a grey-box model: nonlinear least squares of simulated runs, and cross-validation.

The start of every run is eliminated (Schur complement) with its prior, the first readings. Steps are Levenberg and
Marquardt's; several dampings are tried at once, as lanes of one simulation.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from ambient_trainer.data.trace import Array
from ambient_trainer.diagnosis.greybox.model import GreyBox
from ambient_trainer.diagnosis.greybox.network import ABSURD_DEGC
from ambient_trainer.diagnosis.record import Record

BLOCKS, FOLDS = 15, 5
LEFT_OUT, EACH_FOLD = ((1, 1), (2, 2), (3, 3), (3, 4), (4, 4)), tuple((each, each) for each in range(5))
"""Blocks show the scatter; folds of several are left out together, so that their ends are foretold, not bridged."""
_REFIT_STEPS, _STRETCHES = 6, 60
_MOST_MOVE = 1.5
"""Of a coordinate, when a fold is left out: further away the straight line is none."""
_STEP, _TINY = 1e-4, 1e-100
_START_SD_DEGC, _HIDDEN_SD_DEGC = 0.3, 4.0
_INDEPENDENT, _PRIOR_WEIGHT, _NEAR_SD = 50.0, 20.0, 0.15
"""Readings that are worth as much as a whole log of correlated residuals, beside a prior."""
_DAMPINGS = 10.0 ** np.array([-6.0, -3.0, -2.0, -1.0, 0.0, 1.0, 2.0, 4.0])
_MOST_STEP = 2.0
_LARGE, _CACHED = 1_000_000, 200_000
"""Temperatures: more are simulated step by step in parts that stay in a cache, which takes 0.6 of the time."""


@dataclass(frozen=True)
class Prior:
    """Gaussian prior of a model's first k parameters: mean z (k,) and precision (k, k)."""

    z: Array
    precision: Array

    @staticmethod
    def of(model: GreyBox) -> Prior:
        """By the circuit's file: each number is about where it begins."""
        return Prior(model.z(), np.diag([each.prior_sd**-2 for each in model.numbers]))

    @staticmethod
    def trained(fitted: Fitted) -> Prior:
        """By the readings of a fit, which count ``_PRIOR_WEIGHT`` times as much as those of a later one.

        What has changed since is not taken up by numbers that they determine; others stay near, where slopes are
        straight lines.
        """
        J, r = fitted.slopes, fitted.residual
        known = fitted.prior.extended(fitted.model).precision + np.diag([_NEAR_SD**-2] * J.shape[1])
        return Prior(fitted.model.z(), np.asarray(_PRIOR_WEIGHT * _INDEPENDENT / float(r @ r) * (J.T @ J) + known))

    def extended(self, model: GreyBox) -> Prior:
        """The same for all numbers of ``model``, of which the first are these."""
        count = len(self.z)
        rest = model.numbers[count:]
        if not rest:
            return self
        own = np.diag([each.prior_sd**-2 for each in rest])
        return Prior(np.concatenate([self.z, model.z()[count:]]), block_diag(self.precision, own))


@dataclass(frozen=True)
class Linearised:
    """A record's simulation linearised in the parameters: residual (M,), Jacobian (M, p), and those of the start."""

    residual: Array
    slopes: Array
    start: Array
    start_slopes: Array
    start_weight: Array
    start_expected: Array

    @cached_property
    def start_prior(self) -> Array:
        """The weight of what is expected of the start: beside correlated residuals a first reading counts as much as it
        does beside so many independent ones."""
        return self.start_weight * max(float(self.residual @ self.residual) / _INDEPENDENT, 1.0)

    def restricted_to(self, record: Record, without: Record) -> Linearised:
        """The same beside the readings alone that ``without`` has of those of its record."""
        own = np.isfinite(without.sensors).ravel()[record.valid]
        return replace(self, residual=self.residual[own], slopes=self.slopes[own], start_slopes=self.start_slopes[own])


@dataclass(frozen=True)
class Fitted:
    """A model at its least squares on ``records``, M valid readings in all."""

    model: GreyBox
    records: Sequence[Record]
    runs: tuple[Linearised, ...]
    blocks: tuple[Array, ...]
    prior: Prior
    """Of the numbers that the circuit had before any mechanism was added."""
    validated: Array | None = None
    """What :attr:`held_out` is where folds were left out in earnest, (F,)."""

    @cached_property
    def residual(self) -> Array:
        """Measured minus simulated of every valid reading, times its weight, (M,)."""
        return np.concatenate([run.residual for run in self.runs])

    def residual_degC(self, index: int) -> Array:
        """Measured minus simulated of one record, (s, N); NaN where nothing was measured."""
        record = self.records[index]
        result = np.full(record.sensors.shape, np.nan)
        result.flat[record.valid] = self.runs[index].residual
        return np.asarray(result / record.weights)

    def without_slopes(self) -> Fitted:
        """The same without what it takes most memory to keep, for comparing errors alone."""
        nothing = np.empty((0, 0))
        return replace(self, runs=tuple(replace(run, slopes=nothing, start_slopes=nothing) for run in self.runs))

    @property
    def slopes(self) -> Array:
        """Of the simulation in every coordinate, starts re-optimised, (M, p); not kept, as trials are many."""
        return np.concatenate([_profiled(run, run.slopes) for run in self.runs])

    @cached_property
    def _basis(self) -> Array:
        """What slopes span, (M, p)."""
        return np.linalg.qr(self.slopes)[0] if self.slopes.size else np.zeros((len(self.residual), 0))

    def project_out(self, columns: Array) -> Array:
        """Columns (M, ...) projected onto the orthogonal complement of the model's Jacobian."""
        return np.asarray(columns - self._basis @ (self._basis.T @ columns))

    @cached_property
    def block(self) -> Array:
        """The block of time of every reading, (M,)."""
        return np.concatenate(self.blocks)

    @cached_property
    def fold(self) -> Array:
        """The fold of every reading, (M,)."""
        return np.asarray(self.block * FOLDS // BLOCKS)

    @cached_property
    def stretch(self) -> Array:
        """The short stretch of its record of every reading, (M,)."""
        return np.concatenate([_stretches(record) for record in self.records])

    @property
    def at_bounds(self) -> set[int]:
        """Which numbers of mechanisms, by their place among all, stand at a physical bound."""
        own = len(self.prior.z)
        return {own + index for index, each in enumerate(self.model.numbers[own:]) if each.at_bound}

    @property
    def rmse_degC(self) -> float:
        """In-sample."""
        return float(np.sqrt(np.mean(self.residual**2)))

    @property
    def by_fold(self) -> FoldData:
        """The readings of each fold."""
        return FoldData.of(self.slopes, self.residual, self.fold)

    @property
    def by_stretches(self) -> FoldData:
        """The data in interleaved short stretches: a temporary effect is seen on both sides of each."""
        return FoldData.of(self.slopes, self.residual, self.stretch % FOLDS)

    @cached_property
    def held_out(self) -> Array:
        """Sum of squares of the first fold, and of each other when it is left out of the fit, to first order, (F,)."""
        if self.validated is not None:
            return self.validated
        return self.by_fold.normal.held_out(self.ridge)

    @cached_property
    def held_out_stretches(self) -> Array:
        """As :attr:`held_out`, but by cross-validation over the interleaved stretches of :attr:`by_stretches`, (F,)."""
        return self.by_stretches.normal.held_out(self.ridge, EACH_FOLD)

    def refitted(self, most_degC: float = np.inf) -> Fitted:
        """The same with :attr:`held_out` by a fit without each fold, not to first order; no end of it where it leaves
        more than ``most_degC``.

        What the other folds say nothing of stays as it is: the circuit's file is no evidence against it.
        """
        squares, own = [float(self.by_fold.normal.square[0])], len(self.prior.z)
        most = (1 + 1e-9) * most_degC**2 * left_out_count(self.fold)
        prior = self.prior if self.records[0].known_good else replace(self.prior, z=self.model.z()[:own])
        for first, last in LEFT_OUT:
            without = [
                replace(record, sensors=_masked(record, blocks * FOLDS // BLOCKS, first, last))
                for record, blocks in zip(self.records, self.blocks)
            ]
            seen = [run.restricted_to(*each) for run, *each in zip(self.runs, self.records, without)]
            other = _minimised(self.model, without, seen, _REFIT_STEPS, 1e-2, prior)
            if other is not None:
                squares.append(sum(_left_out_squares(other, *each) for each in zip(self.records, other.runs, without)))
            if other is None or sum(squares) > most:
                return replace(self, validated=np.full(len(LEFT_OUT) + 1, np.inf))
        return replace(self, validated=np.array(squares))

    @cached_property
    def ridge(self) -> Array:
        """The weight of the prior, (p, p)."""
        return _prior_weight(self.prior.extended(self.model), self.runs)

    @property
    def held_out_rmse_degC(self) -> float:
        """Root mean square over all folds."""
        return float(np.sqrt(self.held_out.sum() / left_out_count(self.fold)))

    def by_stretches_degC(self, before: Fitted) -> float:
        """What is left of held-out data by short stretches, beside what ``before`` leaves of it: of a window that is
        left out whole nothing is known."""
        ratio = self.held_out_stretches.sum() / before.held_out_stretches.sum()
        return before.held_out_rmse_degC * float(np.sqrt(ratio))

    @cached_property
    def covariance(self) -> Array:
        """Of the coordinates, by the scatter of whole blocks (a sandwich): residuals within one are correlated."""
        J, r, block = self.slopes, self.residual, self.block
        inverse = np.linalg.pinv(J.T @ J + self.ridge)
        scores = np.array([J[block == b].T @ r[block == b] for b in np.unique(block)])
        count = len(scores)
        return np.asarray(inverse @ (scores.T @ scores) @ inverse * count / max(count - 1, 1))


@dataclass(frozen=True)
class FoldEquations:
    """Normal equations of each fold: J'J (F, p, p), J'r (F, p) and r'r (F,)."""

    H: Array
    g: Array
    square: Array

    @staticmethod
    def of(parts: Iterable[tuple[Array, Array]]) -> FoldEquations:
        """Of the slopes J (m, p) and what is left r (m,) in each fold."""
        parts = list(parts)
        return FoldEquations(
            np.array([rows.T @ rows for rows, _ in parts]),
            np.array([rows.T @ left for rows, left in parts]),
            np.array([left @ left for _, left in parts]),
        )

    def with_columns(self, across: Array, alone: Array, towards: Array) -> FoldEquations:
        """With k further columns S: J'S (F, p, k), S'S (F, k, k) and S'r (F, k)."""
        H = np.block([[self.H, across], [across.transpose(0, 2, 1), alone]])
        return FoldEquations(H, np.concatenate([self.g, towards], axis=1), self.square)

    def moved(self, by: Array) -> FoldEquations:
        """The same where a step ``by`` (p,) has been taken."""
        square = self.square - 2 * self.g @ by + np.einsum("p,fpq,q->f", by, self.H, by)
        return FoldEquations(self.H, self.g - self.H @ by, square)

    def scaled(self, scale: Array) -> FoldEquations:
        """In coordinates of which ``scale`` (p,) of the old ones make one."""
        return FoldEquations(self.H * np.outer(scale, scale), self.g * scale, self.square)

    def held_out(self, ridge: Array, left_out: Sequence[tuple[int, int]] = LEFT_OUT) -> Array:
        """Squares of what is left out, under the least squares of the rest: r_f + J_f (J'J - J_f'J_f)^-1 J_f' r_f.

        Left out are the folds between, and the last two together: what comes later is foretold. The first fold is in
        the fit, and counts as it is: how a run begins is seen nowhere else. Short stretches are left out each.
        """
        whole = self.H.sum(axis=0) + ridge
        result = [] if left_out is EACH_FOLD else [float(max(self.square[0], 0.0))]
        for first, last in left_out:
            here = slice(first, last + 1)
            H, g = self.H[here].sum(axis=0), self.g[here].sum(axis=0)
            move = np.linalg.lstsq(whole - H, g, rcond=1e-12)[0] if len(g) else g
            move = np.clip(move, -_MOST_MOVE, _MOST_MOVE)
            result.append(max(float(self.square[here].sum() + 2 * move @ g + move @ H @ move), 0.0))
        return np.array(result)


@dataclass(frozen=True)
class FoldData:
    """Data by fold: row indices, Jacobian and residual of each."""

    rows: tuple[NDArray[np.intp], ...]
    slopes: tuple[Array, ...]
    left: tuple[Array, ...]

    @staticmethod
    def of(J: Array, r: Array, fold: Array) -> FoldData:
        """Of slopes J (M, p) and what is left r (M,), by the fold of each."""
        rows = tuple(np.flatnonzero(fold == each) for each in range(FOLDS))
        return FoldData(rows, tuple(J[each] for each in rows), tuple(r[each] for each in rows))

    @cached_property
    def normal(self) -> FoldEquations:
        """Their normal equations."""
        return FoldEquations.of(zip(self.slopes, self.left))

    def with_columns(self, S: Array) -> FoldEquations:
        """The normal equations with further columns S (M, k)."""
        parts = [S[each] for each in self.rows]
        return self.normal.with_columns(
            np.array([J.T @ s for J, s in zip(self.slopes, parts)]),
            np.array([s.T @ s for s in parts]),
            np.array([s.T @ r for s, r in zip(parts, self.left)]),
        )


def _masked(record: Record, folds: Array, first: int, last: int) -> Array:
    """The readings of a record without those of some folds."""
    sensors = record.sensors.copy()
    sensors.flat[record.valid[(folds >= first) & (folds <= last)]] = np.nan
    # where a run begins is given: a simulation starts from the first readings
    for row, whole in zip(sensors, record.sensors):
        begin = np.flatnonzero(np.isfinite(whole))[:1]
        row[begin] = whole[begin]
    return sensors


def _left_out_squares(fitted: Fitted, record: Record, run: Linearised, without: Record) -> float:
    """The squares of readings that the fit has not seen."""
    unseen = np.isfinite(record.sensors) & ~np.isfinite(without.sensors)
    read = simulate(fitted.model, record, fitted.model.z()[None], run.start[None])[0]
    left = (record.weights * (record.sensors - read))[unseen]
    with np.errstate(over="ignore"):
        return float(left @ left)


def _stretches(record: Record) -> Array:
    """The stretch of each valid reading."""
    return np.asarray(record.valid % record.samples * _STRETCHES // record.samples)


def left_out_count(fold: Array) -> int:
    """How many readings count, those of the first fold once, others as often as they are left out."""
    return int((fold == 0).sum() + sum(((fold >= first) & (fold <= last)).sum() for first, last in LEFT_OUT))


def _profiled(run: Linearised, columns: Array) -> Array:
    """``columns`` (M, c) less what moving starts takes of them."""
    S = run.start_slopes
    system = S.T @ S + np.diag(run.start_prior)
    return np.asarray(columns - S @ np.linalg.solve(system, S.T @ columns))


def expected_start(model: GreyBox, record: Record) -> tuple[Array, Array]:
    """The start (n,) by the first readings, and the weight of each (n,)."""
    network = model.network(record, model.z()[None])
    first = np.array([row[np.isfinite(row)][0] if np.isfinite(row).any() else np.nan for row in record.sensors])
    overall = float(np.nanmean(first)) if np.isfinite(first).any() else 20.0
    start = np.full(len(network.nodes), overall)
    weight = np.full(len(network.nodes), _HIDDEN_SD_DEGC**-2)
    start[network.reads] = np.where(np.isnan(first), overall, first)
    weight[network.reads] = _START_SD_DEGC**-2
    return start, weight


def simulate(model: GreyBox, record: Record, z: Array, start: Array) -> Array:
    """What the sensors read, (P, s, N)."""
    lanes, each_lane = len(z), record.simulated.samples * start.shape[1]
    if lanes * each_lane > _LARGE and model.network(record, z[:1]).nonlinear:
        lanes = max(_CACHED // each_lane, 1)
    parts = [slice(first, first + lanes) for first in range(0, len(z), lanes)]
    return np.concatenate([model.network(record, z[each]).simulate(start[each]) for each in parts])


def _residual(read: Array, record: Record) -> Array:
    left = record.sensors[None] - read
    left[np.abs(left) >= ABSURD_DEGC] = np.nan
    return record.weighted(left)


def block_of(records: Sequence[Record]) -> tuple[Array, ...]:
    """The block of every valid reading: all records together are cut into equal stretches of time."""
    total = sum(record.samples for record in records)
    result, before = [], 0
    for record in records:
        result.append(np.minimum((before + record.valid % record.samples) * BLOCKS // total, BLOCKS - 1))
        before += record.samples
    return tuple(result)


def linearised(
    model: GreyBox, record: Record, start: Array | None, moved: int | None = None, like: Linearised | None = None
) -> Linearised:
    """The run of ``model`` on ``record``, with slopes by forward differences, all in one simulation.

    Slopes are those of the first ``moved`` coordinates, by default of all; ``like`` is a run of the same nodes.
    """
    z = model.z()
    expected, weight = (like.start_expected, like.start_weight) if like else expected_start(model, record)
    start = expected if start is None else _grown(start, expected)
    p, n = len(z) if moved is None else moved, len(start)
    lanes = np.repeat(z[None], 1 + p + n, axis=0)
    starts = np.repeat(start[None], 1 + p + n, axis=0)
    lanes[1 + np.arange(p), np.arange(p)] += _STEP
    starts[1 + p + np.arange(n), np.arange(n)] += 1.0
    left = _residual(simulate(model, record, lanes, starts), record)
    slopes = (left[0] - left[1 : 1 + p]).T / _STEP
    return Linearised(left[0], _flushed(slopes), start, _flushed((left[0] - left[1 + p :]).T), weight, expected)


def _flushed(slopes: Array) -> Array:
    """Without denormal numbers, in which what decays ends: they make every product slow."""
    return np.asarray(np.where(np.abs(slopes) < _TINY, 0.0, slopes))


def fitted_start(model: GreyBox, record: Record) -> Array:
    """Where a run of ``model`` begins, (n,), by its readings and its first ones; nothing else is fitted."""
    start: Array | None = None
    for _ in range(3):
        run = linearised(model, record, start, moved=0)
        system = run.start_slopes.T @ run.start_slopes + np.diag(run.start_prior)
        pull = run.start_slopes.T @ run.residual + run.start_prior * (run.start_expected - run.start)
        start = run.start + np.linalg.solve(system, pull)
        if not model.network(record, model.z()[None]).nonlinear:
            break
    assert start is not None
    return start


def _grown(start: Array, expected: Array) -> Array:
    """``start`` with nodes that were added since at what is expected of them."""
    return np.concatenate([start, expected[len(start) :]])[: len(expected)]


def fit(
    model: GreyBox,
    records: Sequence[Record],
    starts: Sequence[Array | None] | None = None,
    most: int = 30,
    tolerance: float = 1e-4,
    prior: Prior | None = None,
) -> Fitted | None:
    """The least squares of ``model`` near where it stands; None where it cannot be simulated there."""
    runs = [linearised(model, record, start) for record, start in zip(records, starts or [None] * len(records))]
    return _minimised(model, records, runs, most, tolerance, Prior.of(model) if prior is None else prior)


def _minimised(
    model: GreyBox, records: Sequence[Record], runs: Sequence[Linearised], most: int, tolerance: float, base: Prior
) -> Fitted | None:
    """As :func:`fit`, from known linearisations of the model: Levenberg-Marquardt."""
    z, prior = model.z(), base.extended(model)
    low, high = (np.array(each) for each in zip(*(number.range_z for number in model.numbers))) if len(z) else (z, z)
    if not all(np.isfinite(run.residual).all() for run in runs) or not _finite(runs):
        return None
    for _ in range(most):
        best = _damped_step(model, records, runs, z, prior, (low, high))
        if best is None:
            break
        moved = model.at(best.z)
        there = [linearised(moved, *each, None, run) for each, run in zip(zip(records, best.starts), runs)]
        if not _finite(there):
            break
        z, model, runs = best.z, moved, there
        if best.gained < tolerance:
            break
    return Fitted(model, records, tuple(runs), block_of(records), base)


def fit_near(near: Fitted, model: GreyBox, most: int = 30, tolerance: float = 1e-3) -> Fitted | None:
    """``model`` on the records of another fit, by the same prior, begun where that one's runs begin."""
    return fit(model, near.records, [run.start for run in near.runs], most, tolerance, near.prior)


def _finite(runs: Sequence[Linearised]) -> bool:
    return all(np.isfinite(run.slopes).all() and np.isfinite(run.start_slopes).all() for run in runs)


def _prior_weight(prior: Prior, runs: Sequence[Linearised]) -> Array:
    """The weight of the prior, (p, p), beside readings that are worth ``_INDEPENDENT`` independent ones."""
    total = sum(float(run.residual @ run.residual) for run in runs)
    return np.asarray(total / _INDEPENDENT * prior.precision + 1e-12 * np.eye(len(prior.z)))


@dataclass(frozen=True)
class _DampedStep:
    """Where a damped Gauss-Newton step ends, and by what share it lowers the cost."""

    z: Array
    starts: list[Array]
    gained: float


def _damped_step(
    model: GreyBox,
    records: Sequence[Record],
    runs: Sequence[Linearised],
    z: Array,
    prior: Prior,
    bounds: tuple[Array, Array],
) -> _DampedStep | None:
    p = len(z)
    H, g = np.zeros((p, p)), np.zeros(p)
    back = []
    for run in runs:
        J, S, r = run.slopes, run.start_slopes, run.residual
        K = S.T @ S + np.diag(run.start_prior)
        pull = S.T @ r + run.start_prior * (run.start_expected - run.start)
        cross = S.T @ J
        solved = np.linalg.solve(K, np.column_stack([cross, pull]))
        H += J.T @ J - cross.T @ solved[:, :p]
        g += J.T @ r - cross.T @ solved[:, p]
        back.append((solved[:, :p], solved[:, p]))
    weight = _prior_weight(prior, runs)
    H = H + weight
    g = g + weight @ (prior.z - z)
    scale = np.diag(H) + 1e-12
    lanes = []
    for damping in _DAMPINGS:
        move = np.linalg.lstsq(H + damping * np.diag(scale), g, rcond=1e-14)[0] if p else np.zeros(0)
        largest = np.abs(move).max(initial=0.0)
        move = move * min(1.0, _MOST_STEP / largest) if largest > 0 else move
        lanes.append(np.clip(z + move, *bounds))
    zs = np.array([z, *lanes])
    total = np.einsum("lp,pq,lq->l", zs - prior.z, weight, zs - prior.z)
    starts = []
    for record, run, (along, alone) in zip(records, runs, back):
        start = run.start + alone - (zs - z) @ along.T
        start[0] = run.start
        starts.append(start)
        left = _residual(simulate(model, record, zs, start), record)
        total += np.einsum("lm,lm->l", left, left) + (start - run.start_expected) ** 2 @ run.start_prior
    total = np.where(np.isfinite(total), total, np.inf)
    best = int(np.argmin(total))
    if not best or not np.isfinite(total[0]):
        return None
    return _DampedStep(zs[best], [each[best] for each in starts], float(1.0 - total[best] / total[0]))
