"""Candidates are compared by regression: what each explains of the whitened residual, wherever it may begin and end.

A term that acts from a to b adds what it adds from a on less what it adds from b on, so one Gram matrix of the
responses to every onset scores every window at once.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from ambient_trainer.diagnosis.candidate import Candidate, Span
from ambient_trainer.diagnosis.terms import HeatTerm, Term, beginning, ending
from ambient_trainer.diagnosis.view import View
from ambient_trainer.estimation.noise import Noise

Array = NDArray[np.float64]

_EDGE_UNKNOWNS = 2.0
"""What an onset costs beside a coefficient: it is found among many."""
_DOUBT = 0.1
_SHORTEST_SAMPLES, _SHORTEST_S = 3, 300.0


@dataclass(frozen=True)
class Regression:
    """What all candidates are scored against: R whitened rows of every view, less what the nuisances explain.

    ``keep`` (R,) is 1 where a row was measured; the rows of the prior stand behind. ``basis`` (p, R) spans the
    nuisances, orthonormal; ``left`` (R,) is the residual without them.
    """

    views: tuple[View, ...]
    noise: Noise
    keep: Array
    basis: Array
    left: Array
    normal: Regression | None = None
    """The same of known-good records: what is there too is no change."""

    @staticmethod
    def of(
        views: Sequence[View],
        noise: Noise,
        nuisance_columns: Sequence[Array] = (),
        prior_rows: tuple[Array, Array] | None = None,
        normal: Regression | None = None,
    ) -> Regression:
        """``nuisance_columns`` holds per view what each does to the sensors, (p, s, N).

        ``prior_rows`` are the prior's, (p, q), and what each is off by, (q,).
        """
        residuals = [view.residual_degC for view in views]
        keep = np.concatenate([~np.isnan(noise.white(each)).reshape(-1) for each in residuals]).astype(float)
        left = np.concatenate([np.nan_to_num(noise.white(each)).reshape(-1) for each in residuals]) * keep
        columns = [_starts(views, noise) * keep]
        if len(nuisance_columns) and len(nuisance_columns[0]):
            columns.append(_side_by_side(noise, nuisance_columns) * keep)
        if prior_rows is not None:
            known, off = prior_rows
            more = [np.zeros((len(columns[0]), len(off))), known]
            columns = [np.concatenate([own, rest], axis=1) for own, rest in zip(columns, more)]
            left = np.concatenate([left, off])
            keep = np.concatenate([keep, np.zeros(len(off))])
        basis = _orthonormal(np.concatenate(columns))
        return Regression(tuple(views), noise, keep, basis, left - basis.T @ (basis @ left), normal)

    @property
    def rows(self) -> float:
        """How many rows there are to learn from."""
        return float(self.keep.sum())

    @property
    def square(self) -> float:
        """What is left over, squared and summed."""
        return float(self.left @ self.left)

    def columns(self, candidate: Candidate, onsets_s: Sequence[float | None]) -> Array:
        """The candidate's terms from each onset on, whitened, less the nuisance_columns, (k, onsets, R)."""
        return self._white(candidate, onsets_s, beginning)

    def ends(self, candidate: Candidate, ends_s: Sequence[float | None]) -> Array:
        """What is gone again of the candidate's terms after each end, likewise."""
        return self._white(candidate, ends_s, ending)

    def _white(
        self,
        candidate: Candidate,
        onsets_s: Sequence[float | None],
        drawn: Callable[[View, Term, Sequence[float | None]], Array],
    ) -> Array:
        parts = []
        for view in self.views:
            parts.append([self.noise.white(drawn(view, term, onsets_s)) for term in candidate.terms(view)])
        flat = np.concatenate(
            [np.array(part).reshape(len(part), len(onsets_s), -1) for part in parts],
            axis=-1,
        )
        more = self.keep.shape[-1] - flat.shape[-1]
        flat = np.concatenate([flat * self.keep[: flat.shape[-1]], np.zeros((*flat.shape[:-1], more))], axis=-1)
        flat -= (flat @ self.basis.T) @ self.basis
        return np.asarray(flat)


@dataclass(frozen=True)
class Screened:
    """A candidate at its best: when, with which coefficients, and how much of the square that explains.

    ``onset_s`` and ``end_s`` are None where it acts from the start or to the end. ``score`` is twice the gain in log
    likelihood less a penalty for every unknown (Schwarz 1978).
    """

    candidate: Candidate
    onset_s: float | None
    end_s: float | None
    values: Array
    explained: float
    score: float


def scored(regression: Regression, candidate: Candidate, onsets_s: Sequence[float]) -> Screened | None:
    """The candidate at its best over the windows that its span allows; None where none is plausible."""
    starts: list[float | None] = [None]
    if candidate.window is not None:
        starts.extend(each for each in candidate.window if each is not None)
    elif candidate.span is not Span.WHOLE:
        starts.extend(onsets_s)
    gram, towards, square = _normal_equations(regression, candidate, starts)
    G, columns = len(starts), towards.shape[1]
    begin, end = _windows(candidate.span, G)
    if candidate.window is not None:
        begin = np.array([0 if candidate.window[0] is None else 1], dtype=np.intp)
        end = np.array([G if candidate.window[1] is None else G - 1], dtype=np.intp)
    # a term with a lag ends otherwise than it begins: its ends stand behind all beginnings
    D, M = _differences(gram, towards, begin, np.where(end == G, columns, end + columns - G))
    values, explained = _solved(D, M, candidate.fixed)
    lasts = np.array([-np.inf, *starts[1:], np.inf], dtype=float)
    fine = candidate.plausible(values) & (explained < square) & (lasts[end] - lasts[begin] >= _shortest_s(regression))
    unknowns = candidate.free + (candidate.shape is not None)
    edges = (begin > 0).astype(float) + (end < G)
    rows = regression.rows
    score = rows * -np.log1p(-np.where(fine, explained, 0.0) / square)
    score = score - np.log(rows) * (unknowns + _EDGE_UNKNOWNS * edges)
    score[~fine] = -np.inf
    if not len(score) or not np.isfinite(score.max()):
        return None
    best = int(score.argmax())
    return Screened(
        candidate,
        starts[begin[best]],
        None if end[best] == G else starts[end[best]],
        values[best],
        float(explained[best]),
        float(score[best]),
    )


def _normal_equations(
    regression: Regression, candidate: Candidate, starts_s: Sequence[float | None]
) -> tuple[Array, Array, float]:
    """Gram matrix (k, G, k, G) of the columns, their products with what is left, (k, G), and the square of that.

    The columns are those from each of ``starts_s`` on, and, for terms with a lag, those after each of them as an end.
    Where there are known-good records, what the candidate explains of them is taken out first: only what it does
    beyond that is a change.
    """
    X = regression.columns(candidate, starts_s)
    if _has_lag(regression, candidate):
        X = np.concatenate([X, regression.ends(candidate, starts_s)], axis=1)
    k, G, R = X.shape
    flat = X.reshape(k * G, R)
    gram, towards, square = flat @ flat.T, flat @ regression.left, regression.square
    if regression.normal is not None:
        before = regression.normal.columns(candidate, [None])[:, 0]
        normal, own = before @ before.T, X[:, 0] @ X[:, 0].T
        # what the known-good records hardly hold they do not constrain
        doubt = _DOUBT * np.diag(np.diag(own)) + 1e-12 * np.eye(k)
        apparent = np.linalg.solve(normal + doubt, before @ regression.normal.left)
        apparent = np.array([each if fixed is None else 0.0 for each, fixed in zip(apparent, candidate.fixed)])
        towards = towards - flat @ X[:, 0].T @ apparent
        square = square - float(2 * apparent @ (X[:, 0] @ regression.left) - apparent @ own @ apparent)
    return gram.reshape(k, G, k, G), towards.reshape(k, G), square


def _has_lag(regression: Regression, candidate: Candidate) -> bool:
    terms = candidate.terms(regression.views[0])
    return any(isinstance(term, HeatTerm) and term.lag_s is not None for term in terms)


def _shortest_s(regression: Regression) -> float:
    return max(_SHORTEST_S, _SHORTEST_SAMPLES * regression.views[0].plant.period_s)


def refined(regression: Regression, coarse: Screened, step_s: float) -> Screened:
    """``coarse`` with onset and end to the sample, its shape to a percent; ``step_s`` is the coarse grid's."""
    best = (
        coarse if coarse.candidate.window is not None else _plainest(regression, _in_time(regression, coarse, step_s))
    )
    shape, reshaped = best.candidate.shape, best.candidate.reshaped
    if shape is None or reshaped is None:
        return best
    fixed_window = [each for each in (best.onset_s, best.end_s) if each is not None]

    def at(log_factor: float) -> Screened | None:
        return scored(regression, reshaped(shape * float(np.exp(log_factor))), fixed_window)

    def cost(log_factor: float) -> float:
        tried = at(log_factor)
        return 0.0 if tried is None else -tried.score

    found = minimize_scalar(cost, bounds=(-1.5, 1.5), method="bounded", options={"xatol": 0.01, "maxiter": 16})
    better = at(float(found.x))
    return better if better is not None and better.score > best.score else best


def _plainest(regression: Regression, best: Screened) -> Screened:
    """``best`` without an edge that hardly matters."""
    for onset_s, end_s in ((None, None), (best.onset_s, None), (None, best.end_s)):
        if (onset_s, end_s) != (best.onset_s, best.end_s):
            tried = scored(regression, replace(best.candidate, window=(onset_s, end_s)), [])
            if tried is not None and tried.score >= _AS_GOOD * best.score:
                return replace(tried, candidate=best.candidate)
    return best


_AS_GOOD = 0.95
_FINER = 12


def _in_time(regression: Regression, coarse: Screened, step_s: float) -> Screened:
    best = coarse
    period = regression.views[0].plant.period_s
    while step_s > period / 4 and (best.onset_s is not None or best.end_s is not None):
        # what jumps shows in few samples: on the way there, at least every other is tried
        finer = period / 4 if step_s <= 2 * period else max(step_s / _FINER, min(2 * period, step_s / 2))
        reach = round(step_s / finer) + 1
        near = [
            float(edge + shift * finer)
            for edge in (best.onset_s, best.end_s)
            if edge is not None
            for shift in range(-reach, reach + 1)
        ]
        tried = scored(regression, best.candidate, sorted(set(near)))
        if tried is None or tried.score <= best.score:
            tried = best
        best, step_s = tried, finer
    return best


def _windows(span: Span, onsets: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Indices of where windows begin and end; the end ``onsets`` is that of the record."""
    if span is Span.WHOLE:
        return np.zeros(1, dtype=np.intp), np.full(1, onsets, dtype=np.intp)
    if span is Span.ONSET:
        return np.arange(onsets), np.full(onsets, onsets, dtype=np.intp)
    begin, end = np.triu_indices(onsets + 1, k=1)
    return begin, end


def _differences(gram: Array, towards: Array, begin: NDArray[np.intp], end: NDArray[np.intp]) -> tuple[Array, Array]:
    """Per window, D (w, k) and M (w, k, k) of response-from-begin less response-from-end."""
    k, G = towards.shape
    padded = np.zeros((k, G + 1, k, G + 1))
    padded[:, :G, :, :G] = gram
    against = np.zeros((k, G + 1))
    against[:, :G] = towards
    D = against[:, begin] - against[:, end]
    M = np.empty((len(begin), k, k))
    for i in range(k):
        for j in range(k):
            block = padded[i, :, j, :]
            M[:, i, j] = block[begin, begin] - block[begin, end] - block[end, begin] + block[end, end]
    return D.T, M


def _solved(D: Array, M: Array, fixed: tuple[float | None, ...]) -> tuple[Array, Array]:
    """Per window the coefficients (w, k) and what they explain of the square, (w,)."""
    free = [index for index, each in enumerate(fixed) if each is None]
    values = np.tile([0.0 if each is None else each for each in fixed], (len(D), 1))
    if free:
        towards = D[:, free] - np.einsum("wij,wj->wi", M[:, free], values)
        inner = M[:, free][:, :, free]
        size = np.einsum("wii->wi", inner)
        # a coefficient without information stays at zero
        inner = inner + np.einsum("wi,ij->wij", 1e-9 * size + 1e-12, np.eye(len(free)))
        values[:, free] = np.linalg.solve(inner, towards[..., None])[..., 0]
    explained = 2 * np.einsum("wi,wi->w", values, D) - np.einsum("wi,wij,wj->w", values, M, values)
    return values, explained


def _side_by_side(noise: Noise, nuisance_columns: Sequence[Array]) -> Array:
    """(p, R): each nuisance acts in every view."""
    return np.concatenate([noise.white(np.array(each)).reshape(len(each), -1) for each in nuisance_columns], axis=1)


def _starts(views: Sequence[View], noise: Noise) -> Array:
    """(sum of n, R): every view starts on its own."""
    blocks = [noise.white(view.starts).reshape(len(view.starts), -1) for view in views]
    result = np.zeros((sum(len(each) for each in blocks), sum(each.shape[1] for each in blocks)))
    row = column = 0
    for block in blocks:
        result[row : row + len(block), column : column + block.shape[1]] = block
        row, column = row + len(block), column + block.shape[1]
    return result


def _orthonormal(rows: Array) -> Array:
    """An orthonormal basis (p, R) of what ``rows`` span, without what is rounding."""
    length = np.linalg.norm(rows, axis=1)
    rows = rows[length > 0] / length[length > 0, None]
    if not len(rows):
        return rows
    values, vectors = np.linalg.eigh(rows @ rows.T)
    solid = values > 1e-10 * values[-1]
    return np.asarray((vectors[:, solid] / np.sqrt(values[solid])).T @ rows)
