"""Robustness of a model to missing, coarse and wrong sensor readings.

Every condition changes a trace and runs it through the recursion that the device runs. A wrong sensor is wrong for
20 minutes from the middle of the trace on, after an hour of right readings, or for 20 samples after 60 where those are
longer.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ambient_model.model import Model
from ambient_model.tracking import TRACKING, nearest_discrete
from ambient_trainer.data import Array, Trace, sampling_period_s
from ambient_trainer.evaluation.evaluate import tracked
from ambient_trainer.report import Figure, Plot, Section, Table, plots

_BEFORE_S, _BEFORE = 3600.0, 60
_WRONG_S, _WRONG = 1200.0, 20
_NOTICED_S = 10.0
"""A wrong reading may pass as right for so long, or for one sample."""
_OFF_DEGC = 2.0
_COLUMNS = ("condition", "RMSE", "largest error", "in 90 %", "tracking", f"tracking, > {_OFF_DEGC:g} degC off")
_CAPTION = (
    "Errors in degC. In 90 %: the percentage of samples whose reference lies in the published 90 % interval. "
    f"Tracking: the percentage of samples with that status, and of those the ones more than {_OFF_DEGC:g} degC off. "
    "A wrong sensor counts from 10 s after it became wrong. No RMSE: no sample has an estimate and a reference."
)

Change = Callable[[Array, np.random.Generator], Array]
"""From readings (n, m) to what the device gets of them, NaN where missing."""


@dataclass(frozen=True)
class Stressed:
    """A model under one condition: errors in degC, shares from 0 to 1; None where no sample has an error."""

    condition: str
    rmse_degC: float | None
    largest_degC: float | None
    coverage90: float | None
    tracking: float
    tracking_off: float


def stress(model: Model, trace: Trace, seed: int = 0, from_s: float = -np.inf) -> tuple[Stressed, ...]:
    """Run ``model`` over ``trace``, which can be evaluated, under every condition, and score it from ``from_s`` on."""
    period_s = sampling_period_s(trace.time_s)
    first_s = max(from_s, float(trace.time_s[0]))
    found = [_stressed(name, model, trace, change, seed, first_s) for name, change in _conditions(model, period_s)]
    middle_s = (first_s + float(trace.time_s[-1])) / 2
    before_s, wrong_s = max(_BEFORE_S, _BEFORE * period_s), max(_WRONG_S, _WRONG * period_s)
    part = trace.cut(middle_s - before_s, middle_s + wrong_s)
    onset = int(np.searchsorted(part.time_s, middle_s))
    noticed_s = float(part.time_s[onset]) + max(_NOTICED_S, period_s)
    for fault, wrong in FAULTS.items():
        for i, each in enumerate(model.main.inputs):
            if each.unit == "degC":
                change = partial(_wrong, wrong=wrong, i=i, onset=onset)
                found.append(_stressed(f"{each.name}: {fault}", model, part, change, seed, noticed_s))
    return tuple(found)


def _stressed(condition: str, model: Model, trace: Trace, change: Change, seed: int, from_s: float) -> Stressed:
    columns = [each.column for each in model.main.inputs]
    readings = np.column_stack([trace.column(column) for column in columns])
    changed = dict(zip(columns, change(readings.copy(), np.random.default_rng(seed)).T))
    discrete = nearest_discrete(model.main, sampling_period_s(trace.time_s))
    found = tracked(model, discrete, replace(trace, columns={**trace.columns, **changed}))
    counted = trace.time_s >= from_s
    error = np.abs(trace.reference - found.ambient_degC)
    known = counted & np.isfinite(error)
    inside = (found.low_degC <= trace.reference) & (trace.reference <= found.high_degC)
    tracking = found.status[counted] == TRACKING
    off = (found.status[known] == TRACKING) & (error[known] > _OFF_DEGC)
    shares = float(np.mean(tracking)), int(off.sum()) / max(1, int(tracking.sum()))
    if not known.any():
        return Stressed(condition, None, None, None, *shares)
    rmse_degC = float(np.sqrt(np.mean(error[known] ** 2)))
    return Stressed(condition, rmse_degC, float(error[known].max()), float(np.mean(inside[known])), *shares)


def _conditions(model: Model, period_s: float) -> Iterator[tuple[str, Change]]:
    def missing(u: Array, random: np.random.Generator, share: float) -> Array:
        return np.where(random.random(u.shape) < share, np.nan, u)

    def tenth(u: Array, random: np.random.Generator) -> Array:
        """Each sensor at its own phase."""
        phase = random.integers(10, size=u.shape[1])
        return np.where((np.arange(len(u))[:, None] + phase) % 10 == 0, u, np.nan)

    def coarse(u: Array, random: np.random.Generator, step: float, whole: Callable[[Array], Array]) -> Array:
        return np.where([each.unit == "degC" for each in model.main.inputs], step * whole(u / step), u)

    yield "as logged", lambda u, random: u
    for share in (0.01, 0.05, 0.1):
        yield f"{share:.0%} of the readings missing", partial(missing, share=share)
    yield "bursts of a minute missing", partial(_bursts, length=max(1, round(60.0 / period_s)))
    yield "one reading in ten", tenth
    for step in (0.5, 1.0):
        for how, whole in (("rounded", np.round), ("truncated", np.trunc)):
            yield f"{how} to {step:g} degC", partial(coarse, step=step, whole=whole)


def _bursts(u: Array, random: np.random.Generator, length: int) -> Array:
    """Each sensor is away for a minute about every 20 minutes."""
    for column in u.T:
        for start in np.flatnonzero(random.random(len(u)) < 1 / (20 * length)):
            column[start : start + length] = np.nan
    return u


Wrong = Callable[[Array, int], Array]
"""From the readings (n, m) since a sensor became wrong, and its number, to what it reports."""

FAULTS: dict[str, Wrong] = {
    "-40 degC": lambda u, i: np.full(len(u), -40.0),
    "0 degC": lambda u, i: np.zeros(len(u)),
    "85 degC": lambda u, i: np.full(len(u), 85.0),
    "125 degC": lambda u, i: np.full(len(u), 125.0),
    "degrees for millidegrees": lambda u, i: u[:, i] / 1000,
    "stuck": lambda u, i: np.full(len(u), u[0, i]),
    "swapped with the next": lambda u, i: u[:, (i + 1) % u.shape[1]],
    "5 K too much": lambda u, i: u[:, i] + 5.0,
}


def _wrong(u: Array, random: np.random.Generator, wrong: Wrong, i: int, onset: int) -> Array:
    u[onset:, i] = wrong(u[onset:], i)
    return u


def section_of(results: Sequence[Stressed]) -> Section:
    """One table of all conditions, and one picture."""
    rows = []
    for each in results:
        errors = ("-" if error is None else f"{error:.2f}" for error in (each.rmse_degC, each.largest_degC))
        shares = (each.coverage90, each.tracking, each.tracking_off)
        percents = ("-" if share is None else f"{100 * share:.1f}" for share in shares)
        rows.append((each.condition, *errors, *percents))
    return Section("Stress", [Table(_CAPTION, _COLUMNS, rows), Figure(partial(_figure, results))])


def _figure(results: Sequence[Stressed]) -> Plot:
    figure = plots.panel_figure("error [°C]", "", 120 + 18 * len(results))
    shown = list(reversed(results))
    names = [each.condition.replace("degC", "°C") for each in shown]
    figure.add_bar(x=[each.largest_degC for each in shown], y=names, orientation="h", name="largest")
    figure.add_bar(x=[each.rmse_degC for each in shown], y=names, orientation="h", name="RMSE")
    return figure
