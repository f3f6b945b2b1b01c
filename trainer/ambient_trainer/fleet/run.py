"""Fit of a fleet: initialise a population, summarise every unit, estimate the population, fit every unit.

Two maps and a small reduction. A chunk that is done is a file in ``OUT/.parts``: what is interrupted goes on there with
``resume``. The driver reads no log and holds no more than a few chunks; the reduction takes them in their order, so the
result does not depend on who did what when.
"""

import hashlib
import io
import itertools
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
import pandas as pd

from ambient_model import __version__
from ambient_model.faults import Refused, refuse
from ambient_model.trace import REFERENCE
from ambient_trainer.data.trace import sha256_of
from ambient_trainer.estimators import Effort, estimator, thermal_circuit
from ambient_trainer.estimators.model_file import MAIN
from ambient_trainer.fleet import fit_units, outliers
from ambient_trainer.fleet.causes import Outlier
from ambient_trainer.fleet.dataset import FEWEST, Entry, entries, model_name, too_few
from ambient_trainer.fleet.engine import Engine, Tasks, unpacked
from ambient_trainer.fleet.fit_units import PopulationModel, Question, Start, UnitStatistics
from ambient_trainer.fleet.parts import Progress, Stage, TaskResults, write_whole
from ambient_trainer.fleet.pooling import NormalEquations, Population, pooled

CHUNK = 50
"""Units a task: at one a task, the engine costs six times the work."""
_BEGUN_WITH = 24
_TRIED = 4
_STARTS_A_TASK = 2
_LEARNT_FROM = 500
"""Units of the reduction: more change the between-unit covariance by less than a unit's own log does."""
_LONGEST = 100
_CORRELATION_PERCENT = 75


@dataclass(frozen=True)
class FleetFit:
    """A fitted fleet.

    ``table`` has a row a unit in the order of their names; ``outliers`` are the units that fit the population least,
    the least probable first.
    """

    circuit: str
    folder: str
    table: pd.DataFrame = field(repr=False)
    population: Population = field(repr=False)
    start: Start = field(repr=False)
    groups: tuple[tuple[str, ...], ...]
    outliers: tuple[Outlier, ...]

    @property
    def failed(self) -> pd.DataFrame:
        """The units that could not be fitted, with the reason."""
        return self.table[self.table["status"] == fit_units.FAILED]


def fit_fleet(
    question: Question,
    folder: str,
    engine: Engine,
    resume: bool = False,
    progress: Progress = lambda *_: None,
    announce: Callable[[str], None] = lambda _: None,
) -> FleetFit:
    """Fit every unit, and write ``fleet.parquet``, ``models/UNIT.json`` and ``population.json`` into ``folder``.

    ``engine`` is started once the question and the dataset have been looked at. Raises :class:`Refused` for a dataset
    without two units that can be read, an estimator that does not give the ambient, and ``resume`` of another question.
    """
    listed = _listed(question, progress)
    parts = TaskResults(folder, _identity(question, listed), resume, engine, progress)
    with engine:
        if engine.address:
            announce(engine.address)
        return _fitted(question, listed, folder, parts)


def _listed(question: Question, progress: Progress) -> list[Entry]:
    """The units of the dataset, once all that is asked is known to exist."""
    estimator(question.circuit, question.sensors)
    if question.forward is not None:
        try:
            thermal_circuit(question.forward)
        except Refused as refused:  # a name that none has is refused as the circuit's
            raise Refused("diagnose" if refused.source == "circuit" else refused.source, [*refused.faults]) from refused
    progress("listing units", 0, 1)
    listed = entries(question.path, question.source)
    if sum(each.fault is None for each in listed) < FEWEST:
        raise too_few(question.path, [(each.unit, each.fault) for each in listed])
    return listed


def _fitted(question: Question, listed: Sequence[Entry], folder: str, parts: TaskResults) -> FleetFit:
    start = _initialised(parts, question, listed)
    columns = dict.fromkeys([*start.fit.inputs, *(each for space in start.spaces.values() for each in space.inputs)])
    source = replace(question.source, columns=(*columns, REFERENCE))
    chunks = [listed[first : first + CHUNK] for first in range(0, len(listed), CHUNK)]
    unread = "its worker died whenever it was read: too large for its memory, or damaged"
    looking = Tasks(fit_units.summarise, chunks, (source, start), lambda entry: UnitStatistics(entry.unit, (), unread))
    summaries = parts.stage("look", "summarising units", looking)
    pool = _pooled_model(summaries, start, question)
    died = partial(fit_units.failed, within=source.within, reason="its worker died")
    fitting = Tasks(fit_units.fit_chunk, summaries, (start, pool, parts.created), died)
    fitted = parts.stage("fit", "fitting units", fitting)
    found = _written(fitted, folder, question.circuit, start, pool, parts.created)
    if question.forward is not None:
        found = replace(found, outliers=_diagnosed(parts, found, question, listed))
    parts.remove()
    return found


def _identity(question: Question, listed: Sequence[Entry]) -> str:
    """What a run's parts belong to: the units as they lie there, and all that is asked."""
    named = (question.circuit, question.forward or "")
    circuits = tuple(sha256_of(each) if os.path.isfile(each) else each for each in named)
    effort = question.effort
    asked = (__version__, CHUNK, circuits, question.source, question.sensors, effort.starts, effort.seed)
    digest = hashlib.sha256(repr(asked).encode())
    for each in listed:
        digest.update(repr((each.unit, each.size, each.fault, [piece.row_group for piece in each.pieces])).encode())
    return digest.hexdigest()


def _initialised(parts: TaskResults, question: Question, listed: Sequence[Entry]) -> Start:
    """The estimator on the longest logs, which say most of time constants; as many more are tried as may be broken.

    Where its searches may be made apart, a task makes a few of them.
    """

    def died(_: Effort) -> None:
        raise refuse(question.path, "", "the worker that fitted the population died", "give the workers more memory")

    longest = sorted(listed, key=lambda each: (each.fault is not None, -each.rows, each.unit))
    effort = question.effort
    shares = [effort]
    if estimator(question.circuit, question.sensors).starts_apart:
        firsts = range(0, effort.starts, _STARTS_A_TASK)
        shares = [replace(effort, first=first, starts=min(_STARTS_A_TASK, effort.starts - first)) for first in firsts]
    rest = (longest[: _TRIED * _BEGUN_WITH], question, _BEGUN_WITH)
    begun = parts.stage(
        "begin", "fitting the longest logs", Tasks(fit_units.initialise, [[each] for each in shares], rest, died)
    )
    ends: list[Start] = [end for (end,) in begun.results()]
    best = min(ends, key=lambda each: each.fit.rmse_degC)
    rmses_degC = tuple(rmse for each in ends for rmse in each.fit.start_rmses_degC)
    spent = sum(each.fit.evaluations for each in ends)
    return replace(best, fit=replace(best.fit, effort=effort, evaluations=spent, start_rmses_degC=rmses_degC))


def _pooled_model(summaries: Stage, start: Start, question: Question) -> PopulationModel:
    """The population of each member, from units at equal distances and the longest logs."""
    rows = []
    for number, chunk in enumerate(summaries.results()):
        for index, each in enumerate(chunk):
            rows.append((number, index, each.unit, each.reason, each.group, each.seconds, each.correlation_s))
    brief = pd.DataFrame(rows, columns=["chunk", "index", "unit", "reason", "group", "seconds", "memory_s"])
    if brief["reason"].isna().sum() < FEWEST:
        raise too_few(question.path, zip(brief["unit"], brief["reason"]))
    brief = brief[brief["reason"].isna()]
    by_time = brief.sort_values("memory_s", kind="stable")
    share = by_time["seconds"].cumsum().to_numpy() / brief["seconds"].sum()
    # a short log shows too little autocorrelation: the least is that of an error that decays as the device does, whose
    # autocorrelation exp(-t/T) has the integral 2 T
    measured_s = float(by_time["memory_s"].iloc[np.searchsorted(share, _CORRELATION_PERCENT / 100)])
    correlation_s = max(measured_s, 2 * start.spaces[MAIN].slowest_s)
    if len(brief) > _LEARNT_FROM:
        evenly = brief.sort_values("group", kind="stable").iloc[np.arange(_LEARNT_FROM) * len(brief) // _LEARNT_FROM]
        longest = brief.sort_values("seconds", kind="stable", ascending=False).head(_LONGEST)
        brief = brief.loc[sorted({*evenly.index, *longest.index})]
    units: list[UnitStatistics] = []
    for number, part in brief.groupby("chunk"):
        there = unpacked(summaries[number])
        units += [there[index] for index in part["index"]]
    groups = tuple(sorted({each.group for each in units}))
    numbers = np.array([groups.index(each.group) for each in units])
    members = zip(*(each.members for each in units))
    stacked = map(NormalEquations.stacked, members)
    populations = {name: pooled(each, numbers, correlation_s) for name, each in zip(start.spaces, stacked)}
    return PopulationModel(populations, groups, question.source.within)


def _written(fitted: Stage, folder: str, circuit: str, start: Start, pool: PopulationModel, created: str) -> FleetFit:
    """The model files, the table with each unit's improbability, and the population."""
    models = os.path.join(folder, "models")
    os.makedirs(models, exist_ok=True)
    rows = []
    for each in itertools.chain.from_iterable(fitted.results()):
        rows.append(each.row)
        path = os.path.join(models, model_name(each.row["unit"]))
        if each.model is not None:
            write_whole(path, each.model.encode())
        elif os.path.exists(path):  # of a run before
            os.unlink(path)
    table = outliers.scored(pd.DataFrame(rows))
    stream = io.BytesIO()
    table.to_parquet(stream, index=False)
    write_whole(os.path.join(folder, "fleet.parquet"), stream.getvalue())
    units = int(table["improbability"].notna().sum())
    write_whole(os.path.join(folder, "population.json"), fit_units.unseen_model(start, pool, units, created).encode())
    main = pool.populations[MAIN]
    return FleetFit(circuit, folder, table, main, start, pool.groups, outliers.least_probable(table))


def _diagnosed(parts: TaskResults, found: FleetFit, question: Question, listed: Sequence[Entry]) -> tuple[Outlier, ...]:
    """The outliers with the cause of each that is worth a diagnosis."""
    places = {each.unit: each for each in listed}
    worst = outliers.to_diagnose(found.outliers)
    if not worst:
        return found.outliers
    good, rest = [places[unit] for unit in outliers.typical(found.table)], (question.source, question.forward)
    learning = Tasks(outliers.learn_typical, [[good]], rest, lambda _: "the worker that fitted typical units died")
    ((known,),) = parts.stage("typical", "learning typical units", learning).results()
    died, wanted = partial(outliers.undiagnosed, reason="its worker died"), [[places[unit]] for unit in worst]
    job = Tasks(outliers.diagnose_units, wanted, (question.source, known), died)
    named = {each.unit: each for (each,) in parts.stage("diagnosis", "diagnosing outliers", job).results()}
    return tuple(named.get(each.unit, each)._replace(improbability=each.improbability) for each in found.outliers)
