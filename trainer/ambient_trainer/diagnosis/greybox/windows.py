"""Estimation of the time window in which an unlogged cause acts, by the score test.

A driver's delay and threshold are refined by the simulation in the same way.

What begins at t_a and ends at t_b adds, to first order, the column of what begins at t_a less that of what begins at
t_b. All pairs of a coarse grid are scored at once; the best is refined on finer ones.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache

import numpy as np
from scipy.optimize import minimize_scalar

from ambient_trainer.data.trace import Array
from ambient_trainer.diagnosis.greybox.model import GreyBox, Mechanism
from ambient_trainer.diagnosis.greybox.regression import Fitted, fit_near, simulate

_COARSE, _FINE, _ROUNDS = 28, 4, 2
_SHORTEST = 5
"""Minimum length of a window in samples."""
_TIMES, _REFITTED, _APART = 10, 8, 0.4
"""Times that are tried for an end of a window, steps of the fit after it, and how far a delay moves, of itself, or a
level, of its column's range."""
_MOST_REFINEMENTS, _LEAST_REFINED = 6, 0.998
"""Maximum number of refinements of a time, each of which moves it a little; and the ratio of the error after one to
that before it from which there is no other."""
_DIVERGED_K2 = 1e100
"""In K^2, what a simulation leaves that is not finite: more than any other."""

Columns = Callable[[Mechanism], Array]


def best_windows(fitted: Fitted, mechanism: Mechanism, columns: Columns) -> Iterator[Mechanism]:
    """``mechanism`` in the window in which it explains most, and in the best that is open on one side.

    A large change bends what it does: to first order it looks as if it had ended, where it has only begun. For a body
    see :func:`add_other_end`.
    """
    known = cache(columns)
    best = best_window(fitted, mechanism, known, closed=not mechanism.adds_nodes)
    if best is None:
        return
    yield best
    if mechanism.adds_nodes:
        yield add_other_end(fitted, best, known)
    elif best.onset_s is not None and best.end_s is not None:
        half = best_window(fitted, mechanism, known, closed=False)
        yield from () if half is None else (half,)


def best_window(fitted: Fitted, mechanism: Mechanism, columns: Columns, closed: bool) -> Mechanism | None:
    """``mechanism`` in the best window of all, or, not ``closed``, of those that are open on one side; None where there
    is none."""
    record = max(fitted.records, key=lambda each: each.samples)
    if record.samples < 4 * _COARSE:
        return None
    begin, end = float(record.time_s[0]), float(record.time_s[-1])
    step, shortest, project = (end - begin) / _COARSE, _SHORTEST * record.period_s, fitted.project_out
    on: Array = begin + step * np.arange(_COARSE, dtype=np.float64)
    off, best = on, None
    for _ in range(_ROUNDS + 1):
        times = np.unique(np.concatenate([on, off]))
        acting = {at: project(columns(replace(mechanism, onset_s=None if at <= begin else float(at)))) for at in times}
        ends = off if mechanism.may_end else off[:0]
        found = _best(acting, on, ends, project(fitted.residual), shortest, begin, closed)
        if found is None:
            break
        first, last = best = found
        step /= _FINE
        nearby = step * np.arange(-_FINE, _FINE + 1)
        on = np.clip(first + nearby, begin, end - shortest)
        off = np.clip((end if last is None else last) + nearby, begin + shortest, end)
    if best is None:
        return None
    return replace(mechanism, onset_s=None if best[0] <= begin else best[0], end_s=best[1])


def add_other_end(fitted: Fitted, body: Mechanism, columns: Columns) -> Mechanism:
    """A temporary body with its best other end, which first-order superposition does not give."""
    record = max(fitted.records, key=lambda each: each.samples)
    project, left = fitted.project_out, fitted.residual
    first, last, shortest = float(record.time_s[0]), float(record.time_s[-1]), _SHORTEST * record.period_s
    if body.onset_s is not None:
        first = body.onset_s + shortest
    elif body.end_s is not None:
        last = body.end_s - shortest

    def at(time_s: float) -> Mechanism:
        return replace(body, onset_s=time_s) if body.onset_s is None else replace(body, end_s=time_s)

    def gain(time_s: float) -> float:
        C = project(columns(at(time_s)))
        return float((C.T @ left) @ np.linalg.pinv(C.T @ C, rcond=1e-9, hermitian=True) @ (C.T @ left))

    step = (last - first) / _COARSE
    best = max((first + step * index for index in range(1, _COARSE)), key=gain)
    for _ in range(_ROUNDS):
        step /= _FINE
        best = max(np.clip(best + step * np.arange(-_FINE, _FINE + 1), first, last).tolist(), key=gain)
    return at(best)


def refine_timing(fitted: Fitted, index: int = -1) -> Fitted:
    """The same with the window, delay or level of a mechanism, the last one, refined by the simulation and fitted
    again, as long as that gains."""
    index %= len(fitted.model.mechanisms)
    for _ in range(_MOST_REFINEMENTS):
        again = fit_near(fitted, _refined_model(fitted, index), _REFITTED)
        if again is None or again.rmse_degC > fitted.rmse_degC:
            break
        gains = again.rmse_degC < _LEAST_REFINED * fitted.rmse_degC
        fitted = again
        if not gains:
            break
    return fitted


def _refined_model(fitted: Fitted, index: int) -> GreyBox:
    """The model with a mechanism's delay or level, or its onset and then its end, where least is left near."""
    model, mechanism = fitted.model, fitted.model.mechanisms[index]
    record = max(fitted.records, key=lambda each: each.samples)
    begin, end = float(record.time_s[0]), float(record.time_s[-1])
    # a large body bends all that it does: to first order it seems to come at another time
    finer = 1 if mechanism.adds_nodes else _FINE**_ROUNDS
    within_s, shortest = 2 * (end - begin) / _COARSE / finer, _SHORTEST * record.period_s
    if (driver := mechanism.driver) is not None and (level := driver.level) is not None:
        apart = _APART * (level if driver.late else float(np.ptp(record.signals[driver.columns[0]])))
        ends = level - apart, level + apart
        return _minimise_over(fitted, model, index, lambda each, at: replace(each, driver=driver.at_level(at)), *ends)
    if (on := mechanism.onset_s) is not None:
        latest = (end if mechanism.end_s is None else mechanism.end_s) - shortest
        ends = max(on - within_s, begin), min(on + within_s, latest)
        model = _minimise_over(fitted, model, index, lambda each, at_s: replace(each, onset_s=at_s), *ends)
    if (off := mechanism.end_s) is not None:
        onset_s = model.mechanisms[index].onset_s
        earliest = (begin if onset_s is None else onset_s) + shortest
        ends = max(off - within_s, earliest), min(off + within_s, end)
        model = _minimise_over(fitted, model, index, lambda each, at_s: replace(each, end_s=at_s), *ends)
    return model


def _minimise_over(
    fitted: Fitted, model: GreyBox, index: int, moved: Callable[[Mechanism, float], Mechanism], low: float, high: float
) -> GreyBox:
    """The model with a mechanism as ``moved`` to where it leaves least; numbers and starts are those of the fit."""

    def at(value: float) -> GreyBox:
        return model.replaced(index, moved(model.mechanisms[index], value))

    @np.errstate(all="ignore")
    def left(value: float) -> float:
        there, total = at(value), 0.0
        for record, run in zip(fitted.records, fitted.runs):
            off = record.weights * (record.sensors - simulate(there, record, there.z()[None], run.start[None])[0])
            total += float(np.sum(off[np.isfinite(record.sensors)] ** 2))
        # what runs away leaves more than anything else
        return total if total < _DIVERGED_K2 else _DIVERGED_K2

    options = {"maxiter": _TIMES, "xatol": (high - low) / 1000}
    return at(float(minimize_scalar(left, bounds=(low, high), method="bounded", options=options).x))


def _best(
    acting: dict[float, Array], on: Array, off: Array, left: Array, shortest: float, begin: float, closed: bool
) -> tuple[float, float | None] | None:
    """Onset and end of the best window (None: to the end of the record); not ``closed`` is open on one side."""
    times = np.array(sorted(acting))
    C = np.concatenate([acting[each] for each in times], axis=1)
    shape = len(times), C.shape[1] // len(times)
    G = (C.T @ C).reshape(*shape, *shape).swapaxes(1, 2)
    b = (C.T @ left).reshape(shape)
    first, last = np.searchsorted(times, on)[:, None], np.searchsorted(times, off)
    open_ended = on[:, None] > begin
    ending = (off - on[:, None] >= shortest) & (closed | ~open_ended)
    ended = G[first, first] + G[last, last] - G[first, last] - G[last, first]
    sizes = np.concatenate([G[first, first], ended], axis=1)
    amounts = np.concatenate([b[first], b[first] - b[last]], axis=1)
    # a window that ends needs one number more
    price = np.array([1.0] + [0.97] * len(off))
    shown = np.trace(sizes, axis1=2, axis2=3) > 1e-12 * G.max()
    gains = np.zeros(shown.shape)
    solved = np.linalg.pinv(sizes[shown], rcond=1e-9, hermitian=True) @ amounts[shown][:, :, None]
    gains[shown] = (price * np.ones_like(gains))[shown] * np.einsum("wk,wk->w", amounts[shown], solved[:, :, 0])
    gains = np.where(np.hstack([open_ended, ending]), gains, -1.0)
    onset, end = np.unravel_index(np.argmax(gains), gains.shape)
    if gains[onset, end] < 0:
        return None
    return float(on[onset]), float(off[end - 1]) if end else None
