"""Worker tasks: initialise a population, summarise a chunk of units, and fit each unit under the population.

A task reads what it needs and returns what the driver keeps; it knows no other task, no folder of the driver and no
clock. The same task gives the same bytes, wherever it runs.
"""

import hashlib
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from ambient_model.codec import encode
from ambient_model.faults import Refused
from ambient_model.model import SCORES
from ambient_model.trace import REFERENCE
from ambient_trainer.data.grid import sampling_period_s
from ambient_trainer.data.trace import Array, Trace, is_reference
from ambient_trainer.estimators import USUAL, Effort, Fit, estimator, model_of
from ambient_trainer.estimators.model_file import MAIN, estimators_of, with_estimators
from ambient_trainer.fleet.dataset import FEWEST, Entry, Log, Source, logs, reason_of, too_few
from ambient_trainer.fleet.pooling import NormalEquations, Population, Posterior, deviance
from ambient_trainer.fleet.space import Space, grids, map_members, members, space_of, with_systems

_GRID_SAMPLES = 20_000
"""The population's time constants are fitted to about so many samples of the units that it is begun with."""
_KEPT = 201
OK, FAILED = "ok", "failed"


@dataclass(frozen=True)
class Question:
    """What is asked: the dataset, the estimator, and the effort of beginning the population."""

    path: str
    circuit: str
    source: Source
    """How the dataset is read before the columns are known."""
    sensors: tuple[str, ...] = ()
    effort: Effort = USUAL
    forward: str | None = None
    """The circuit with which outliers are diagnosed; None: they are not."""


@dataclass(frozen=True)
class Start:
    """The estimator as it was fitted to the first units, and the coordinates about it, by member."""

    fit: Fit
    spaces: Mapping[str, Space]
    units: tuple[str, ...]


@dataclass(frozen=True)
class UnitStatistics:
    """Sufficient statistics of a unit's log for each member's coordinates, or the reason why there are none."""

    unit: str
    group: tuple[str, ...]
    reason: str | None
    samples: int = 0
    seconds: float = 0.0
    sha256: str = ""
    correlation_s: float = 0.0
    blocks: NormalEquations | None = None
    """The normal equations of the main member by blocks of the log."""
    members: tuple[NormalEquations, ...] = ()
    """Those of each member in its order, of the whole log."""


@dataclass(frozen=True)
class PopulationModel:
    """Prior under which units are fitted: the population by member, the groups, and the names of their columns."""

    populations: Mapping[str, Population]
    groups: tuple[tuple[str, ...], ...]
    within: tuple[str, ...]


@dataclass(frozen=True)
class UnitFit:
    """A unit's row of the table, and its model file."""

    row: dict[str, Any]
    model: str | None


def initialise(efforts: Sequence[Effort], wanted: Sequence[Entry], question: Question, enough: int) -> list[Start]:
    """Fit the estimator to the first ``enough`` of ``wanted`` that can be read, on one coarse grid, by each effort.

    Raises :class:`Refused` where fewer than two can be, and as the estimator does.
    """
    with threadpool_limits(1):
        method, columns = estimator(question.circuit, question.sensors), question.sensors
        read: list[Trace] = []
        reasons: dict[str, str | None] = {}
        for log in logs(wanted, question.source):
            reasons[log.unit] = log.reason
            if log.trace is not None:
                read.append(replace(log.trace, path=log.unit))
            if len(read) == enough:
                break
        if method.reads_any and not columns:  # temperatures of more than half, in the order of the first that has them
            counts = Counter(name for trace in read for name in trace.columns if name.endswith("_degC"))
            columns = tuple(name for name, count in counts.items() if 2 * count > len(read) and not is_reference(name))
        periods_s = [sampling_period_s(trace.time_s) for trace in read] or [1.0]
        # a clock that was set within a log makes no long one, and a slower logger no coarse grid for all
        own_s = float(np.quantile(periods_s, 0.5, method="higher"))
        total_s = sum(each * (len(trace.time_s) - 1) for each, trace in zip(periods_s, read) if each <= own_s)
        period_s = max(own_s, float(np.ceil(total_s / _GRID_SAMPLES)))
        traces = []
        for trace in read:
            try:
                training = method.training([trace], columns or None, period_s, 1)
                grids(_thinned(trace, period_s), training.columns)
                traces.append(trace)
            except Refused as refused:
                reasons[trace.path] = reason_of(refused)
        if len(traces) < FEWEST:
            raise too_few(question.path, reasons.items())
        thin, units = [_thinned(trace, period_s) for trace in traces], tuple(trace.path for trace in traces)

        def slim(fit: Fit, _: str) -> Fit:
            """What goes to every worker: quantiles of the errors instead of all of them, and the logs' periods."""
            quantiles = tuple(np.quantile(each, np.linspace(0, 1, _KEPT)) for each in fit.errors_degC)
            return replace(fit, periods_s=(own_s,), errors_degC=quantiles)

        fits = [map_members(method.fit(traces, each, None, period_s, columns or None), slim) for each in efforts]
        return [Start(fit, {name: space_of(each, thin) for name, each in members(fit).items()}, units) for fit in fits]


def _thinned(trace: Trace, period_s: float) -> Trace:
    step = max(1, round(period_s / float(np.median(np.diff(trace.time_s)))))
    columns = {name: values[::step] for name, values in trace.columns.items()}
    return replace(trace, time_s=trace.time_s[::step], columns=columns)


def summarise(wanted: Sequence[Entry], source: Source, start: Start) -> list[UnitStatistics]:
    """Sufficient statistics of each unit of a chunk."""
    with threadpool_limits(1):
        return [_statistics_of(log, start) for log in logs(wanted, source)]


def _statistics_of(log: Log, start: Start) -> UnitStatistics:
    if log.trace is None:
        return UnitStatistics(log.unit, log.group, log.reason)
    trace = log.trace
    try:
        every = {name: space.statistics(trace) for name, space in start.spaces.items()}
    except Refused as refused:
        return UnitStatistics(log.unit, log.group, reason_of(refused))
    digest = hashlib.sha256(np.ascontiguousarray(trace.time_s).tobytes())
    for name in (*start.spaces[MAIN].inputs, REFERENCE):
        digest.update(np.ascontiguousarray(trace.columns[name]).tobytes())
    known = int(np.count_nonzero(np.isfinite(trace.reference)))
    members = tuple(each.total() for each, _ in every.values())
    blocks, tau_s = every[MAIN]
    duration_s = float(members[0].seconds)
    return UnitStatistics(log.unit, log.group, None, known, duration_s, digest.hexdigest(), tau_s, blocks, members)


def fit_chunk(units: Sequence[UnitStatistics], start: Start, pool: PopulationModel, created: str) -> list[UnitFit]:
    """Each unit of a chunk under the population: its row, and its model file."""
    with threadpool_limits(1):
        good = [each for each in units if each.reason is None]
        found = iter(_fitted(good, start, pool, created) if good else ())
        return [next(found) if each.reason is None else failed(each, pool.within) for each in units]


def failed(unit: UnitStatistics, within: Sequence[str], reason: str | None = None) -> UnitFit:
    """The row of a unit that could not be fitted."""
    groups = dict(zip(within, unit.group))
    return UnitFit({"unit": unit.unit, **groups, "status": FAILED, "reason": reason or unit.reason}, None)


def _fitted(summaries: Sequence[UnitStatistics], start: Start, pool: PopulationModel, created: str) -> list[UnitFit]:
    numbers = {name: index for index, name in enumerate(pool.groups)}
    group = np.array([numbers.get(each.group, -1) for each in summaries])
    units = NormalEquations.stacked(each.members[0] for each in summaries)
    population = pool.populations[MAIN]
    posteriors, kept = {}, {}
    for index, (name, each) in enumerate(pool.populations.items()):
        own = each.posterior(NormalEquations.stacked(unit.members[index] for unit in summaries), group)
        posteriors[name], kept[name] = each.bounded_shrinkage(own)
    open_ = population.posterior(units, group).covariance @ np.linalg.inv(population.between)
    deviation = {name: pool.populations[name].deviation_degC(each.covariance) for name, each in posteriors.items()}
    rows = pd.DataFrame(
        {
            "unit": [each.unit for each in summaries],
            **{name: [each.group[index] for each in summaries] for index, name in enumerate(pool.within)},
            "status": OK,
            "reason": None,
            "samples": [float(each.samples) for each in summaries],
            "duration_s": units.seconds,
            "effective_samples": units.seconds / population.correlation_s,
            # how much of each unit is taken from the population, and how much of its own it keeps
            "shrinkage": 1 - kept[MAIN] * (1 - np.trace(open_, axis1=1, axis2=2) / open_.shape[1]),
            "kept": kept[MAIN],
            **_cross_validated(summaries, units, population, group),
            **_fit(units, population, group, posteriors[MAIN]),
            **_readable(start.spaces[MAIN], posteriors[MAIN]),
        }
    ).to_dict("records")
    found = []
    for index, (unit, row) in enumerate(zip(summaries, rows)):
        systems = {name: start.spaces[name].system(each.mean[index]) for name, each in posteriors.items()}
        details = {name: row[name] for name in ("unit", "effective_samples", "shrinkage")}
        training = {"trace": unit.unit, "sha256": unit.sha256, "from_s": None, "to_s": None}
        wide = {name: float(each[index]) for name, each in deviation.items()}
        text = model_text(with_systems(start.fit, systems), wide, details, [training], created)
        found.append(UnitFit(row, text))
    return found


def _fit(units: NormalEquations, population: Population, group: NDArray[np.intp], main: Posterior) -> dict[str, Array]:
    """Misfit of each unit, and its distance from the population."""
    scale = population.variance_degC2 * population.correlation_s
    distance, freedom = deviance(units.H / scale, units.g / scale, *population.prior(group))
    return {
        "half_width_90_degC": SCORES[90] * population.deviation_degC(main.covariance),
        "distance": distance,
        "freedom": freedom,
        # one for a unit whose sensors go together as the population's do
        "leverage": np.trace(units.H, axis1=1, axis2=2) / units.seconds / units.g.shape[1],
        "misfit_degC2": units.squares(main.mean) / units.seconds,
    }


def _readable(space: Space, main: Posterior) -> dict[str, Array]:
    """The DC gains and the offset of each unit, with their 90 % intervals."""
    names, base, follow = space.parameters
    values = base + main.mean @ follow.T
    half = SCORES[90] * np.sqrt(np.einsum("ki,uij,kj->uk", follow, main.covariance, follow))
    columns: dict[str, Array] = {}
    for index, name in enumerate(names):
        value, width = values[:, index], half[:, index]
        columns |= {name: value, f"{name}_low90": value - width, f"{name}_high90": value + width}
    return columns


def _cross_validated(
    summaries: Sequence[UnitStatistics], total: NormalEquations, population: Population, group: NDArray[np.intp]
) -> dict[str, Array]:
    """RMSE of each unit on its own blocks, each held out in turn, under the three ways of pooling."""
    blocks = NormalEquations.stacked(each.blocks for each in summaries if each.blocks)
    squares = np.zeros((3, len(summaries)))
    for number in range(blocks.g.shape[1]):
        block = NormalEquations(*(each[:, number] for each in blocks))
        rest = NormalEquations(*(whole - part for whole, part in zip(total, block)))
        partial, _ = population.bounded_shrinkage(population.posterior(rest, group))
        alone = np.linalg.pinv(rest.H, rcond=1e-9, hermitian=True) @ rest.g[..., None]
        ways = np.broadcast_to(population.mean, rest.g.shape), alone[..., 0], partial.mean
        squares += [block.squares(each) for each in ways]
    rms = np.sqrt(squares / total.seconds)
    return {f"rmse_{way}_degC": each for way, each in zip(("pooled", "separate", "partial"), rms)}


def unseen_model(start: Start, pool: PopulationModel, units: int, created: str) -> str:
    """The model file for a unit that was never seen, with the interval that is honest for it."""
    details = {"units": units, **pool.populations[MAIN].summary}
    systems = {name: space.system(pool.populations[name].mean) for name, space in start.spaces.items()}
    deviation = {name: each.unseen_degC for name, each in pool.populations.items()}
    return model_text(with_systems(start.fit, systems), deviation, details, [], created)


_Entries = Mapping[str, Any]


def model_text(
    fit: Fit, deviation_degC: Mapping[str, float], details: _Entries, training: Sequence[_Entries], created: str
) -> str:
    """The model file of ``fit``, each member's interval that of a normal error of its deviation."""
    model = model_of(replace(fit, details={**fit.details, "fleet": dict(details)}), training, {})
    honest = {}
    for name, each in estimators_of(model).items():
        ends = {level: score * deviation_degC[name] for level, score in SCORES.items()}
        honest[name] = each._replace(interval={level: (-end, end) for level, end in ends.items()})
    return encode(with_estimators(model, honest)._replace(created=created))
