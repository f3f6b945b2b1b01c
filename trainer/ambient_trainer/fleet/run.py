"""The run over a fleet: a population is begun, every unit is looked at, the population is learnt, every unit is fitted.

Two maps and a small reduction. A chunk that is done is a file in ``OUT/.parts``: what is interrupted goes on there with
``resume``. The driver reads no log and holds no more than a few chunks; the reduction takes them in their order, so the
result does not depend on who did what when.
"""

from __future__ import annotations

import contextlib
import datetime
import hashlib
import json
import os
import pickle
import shutil
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any
from urllib.parse import quote

import numpy as np

from ambient_model import __version__
from ambient_model.faults import refuse
from ambient_model.trace import REFERENCE
from ambient_trainer.data.trace import sha256_of
from ambient_trainer.estimators.base import USUAL, Effort
from ambient_trainer.estimators.registry import estimator, thermal_circuit
from ambient_trainer.fleet.dataset import Entry, Source, entries
from ambient_trainer.fleet.engine import Engine
from ambient_trainer.fleet.fit_units import (
    FAILED,
    Fitted,
    Looked,
    Start,
    begin,
    fit_chunk,
    look,
    normal_of,
    unseen_model,
)
from ambient_trainer.fleet.outliers import diagnose_units, least_probable, to_diagnose, typical
from ambient_trainer.fleet.pooling import Population, improbability, pooled
from ambient_trainer.fleet.result import FleetFit, Outlier, save_table, table_of
from ambient_trainer.fleet.space import MAIN

Progress = Callable[[str, int, int], None]
"""Called with what is under way, how much of it is done, and of how much."""

CHUNK = 50
"""Units a task: at one a task, the engine costs six times the work."""
_BEGUN_WITH = 24
_TRIED = 4
_STARTS_A_TASK = 2
_LEARNT_FROM = 500
"""Units of the reduction: more change the between-unit covariance by less than a unit's own log does."""
_LONGEST = 100
_PARTS = ".parts"
_MEMORY_PERCENT = 75


@dataclass(frozen=True)
class Question:
    """What is asked: the dataset, the estimator, and the effort of beginning the population."""

    path: str
    circuit: str
    by: str = "unit"
    within: tuple[str, ...] = ()
    sensors: tuple[str, ...] = ()
    effort: Effort = USUAL
    forward: str | None = None
    """The circuit with which outliers are diagnosed; None: they are not."""


def fit_fleet(
    question: Question, folder: str, engine: Engine, resume: bool = False, progress: Progress = lambda *_: None
) -> FleetFit:
    """Fit every unit, and write ``fleet.parquet``, ``models/UNIT.json`` and ``population.json`` into ``folder``.

    Raises :class:`Refused` for a dataset without two units that can be read, an estimator that does not give the
    ambient, and ``resume`` of another question.
    """
    if not estimator(question.circuit, question.sensors).reads_any and question.sensors:
        raise refuse("--sensors", "", f"{question.circuit} names its own", "leave them out")
    if question.forward is not None:
        thermal_circuit(question.forward)
    source = Source(question.by, question.within)
    progress("listing units", 0, 1)
    listed = entries(question.path, source)
    parts = _Parts(folder, _identity(question, listed), resume)
    start = parts.kept("start", lambda: _begun(question, source, listed, engine, progress))
    wanted = tuple(dict.fromkeys([*start.fit.inputs, *_columns_of(start), REFERENCE]))
    source = Source(question.by, question.within, wanted)
    chunks = [listed[first : first + CHUNK] for first in range(0, len(listed), CHUNK)]

    def looked(number: int) -> tuple[Sequence[Any], tuple[Any, ...]]:
        return chunks[number], (source, start)

    def fitted(number: int) -> tuple[Sequence[Any], tuple[Any, ...]]:
        return parts.load("look", number), (start, populations, groups, question.within, parts.created)

    parts.fill("look", len(chunks), engine, look, looked, _lost, progress, "looking at units")
    populations, groups = parts.kept("population", lambda: _learnt(parts, len(chunks), start))
    parts.fill("fit", len(chunks), engine, fit_chunk, fitted, _unfitted, progress, "fitting units")
    found = _written(parts, len(chunks), folder, question, start, populations, groups)
    if question.forward is not None:
        found = replace(found, outliers=_diagnosed(parts, found, question, listed, engine, progress))
    parts.remove()
    return found


def _diagnosed(
    parts: _Parts, found: FleetFit, question: Question, listed: Sequence[Entry], engine: Engine, progress: Progress
) -> tuple[Outlier, ...]:
    """The outliers with the cause of each that is worth a diagnosis."""
    places = {each.unit: each for each in listed}
    worst, good = to_diagnose(found.outliers), [places[unit] for unit in typical(found.table)]
    rest = (Source(question.by, question.within), good, question.forward)
    parts.fill(
        "diagnosis",
        len(worst),
        engine,
        diagnose_units,
        lambda n: ([places[worst[n]]], rest),
        _undiagnosed,
        progress,
        "diagnosing outliers",
    )
    named = {each.unit: each for number in range(len(worst)) for each in parts.load("diagnosis", number)}
    return tuple(
        each._replace(cause=named[each.unit].cause, location=named[each.unit].location) if each.unit in named else each
        for each in found.outliers
    )


def _undiagnosed(entry: Entry) -> Outlier:
    return Outlier(entry.unit, float("nan"), "not diagnosed: its worker died")


def _columns_of(start: Start) -> list[str]:
    return [name for space in start.spaces.values() for name in space.inputs]


def _begun(question: Question, source: Source, listed: Sequence[Entry], engine: Engine, progress: Progress) -> Start:
    """The estimator on the longest logs, which say most of time constants; as many more are tried as may be broken.

    Where its searches may be made apart, a task makes a few of them.
    """
    longest = sorted(listed, key=lambda each: (each.reason is not None, -each.rows, each.unit))
    items = tuple(longest[: _TRIED * _BEGUN_WITH])
    shares = _shares(question)
    rest = (items, source, question.circuit, question.sensors, _BEGUN_WITH)
    found: dict[int, Start] = {}
    progress("beginning with the longest logs", 0, len(shares))
    for number, (start,) in engine.run(_begin_task, range(len(shares)), lambda n: ([shares[n]], rest), lambda _: None):
        if start is None:
            raise refuse(question.path, "", "the worker that began the population died", "give the workers more memory")
        found[number] = start
        progress("beginning with the longest logs", len(found), len(shares))
    ends = [found[number] for number in range(len(shares))]
    best = min(ends, key=lambda each: each.fit.rmse_degC)
    fit = replace(
        best.fit,
        effort=question.effort,
        evaluations=sum(each.fit.evaluations for each in ends),
        start_rmses_degC=tuple(rmse for each in ends for rmse in each.fit.start_rmses_degC),
    )
    return replace(best, fit=fit)


def _shares(question: Question) -> list[Effort]:
    """The searches that each task makes."""
    effort = question.effort
    if not estimator(question.circuit, question.sensors).starts_apart:
        return [effort]
    begun = range(0, effort.starts, _STARTS_A_TASK)
    return [replace(effort, first=first, starts=min(_STARTS_A_TASK, effort.starts - first)) for first in begun]


def _begin_task(shares: Sequence[Effort], *rest: Any) -> list[Start]:
    return [begin(each, *rest) for each in shares]


def _lost(entry: Entry) -> Looked:
    return Looked(entry.unit, (), "its worker died whenever it was read: too large for its memory, or damaged")


def _unfitted(looked: Looked) -> Fitted:
    return Fitted({"unit": looked.unit, "status": FAILED, "reason": "its worker died"}, None)


def _learnt(parts: _Parts, chunks: int, start: Start) -> tuple[dict[str, Population], tuple[tuple[str, ...], ...]]:
    """The population of each member, from units at equal distances and the longest logs."""
    brief = [
        (number, index, each.group, each.seconds, each.main.memory_s)
        for number in range(chunks)
        for index, each in enumerate(parts.load("look", number))
        if each.main is not None
    ]
    if len(brief) < 2:
        raise refuse(
            "fleet", "", f"{len(brief)} units can be fitted", "a population has two at least: see fleet.parquet"
        )
    seconds, memory = (np.array([each[k] for each in brief]) for k in (3, 4))
    order = np.argsort(memory, kind="stable")
    share = np.cumsum(seconds[order]) / seconds.sum()
    # a short log shows less memory than there is: a device's own time constant is the least
    measured_s = float(memory[order][np.searchsorted(share, _MEMORY_PERCENT / 100)])
    memory_s = max(measured_s, start.spaces[MAIN].slowest_s)
    by_group = sorted(range(len(brief)), key=lambda k: (brief[k][2], k))
    evenly = [by_group[k * len(brief) // _LEARNT_FROM] for k in range(_LEARNT_FROM)]
    longest = sorted(range(len(brief)), key=lambda k: (-seconds[k], k))[:_LONGEST]
    chosen = sorted({*evenly, *longest}) if len(brief) > _LEARNT_FROM else list(range(len(brief)))
    wanted: dict[int, list[int]] = {}
    for k in chosen:
        wanted.setdefault(brief[k][0], []).append(brief[k][1])
    looked = [
        parts_of[index]
        for number in sorted(wanted)
        for parts_of in (parts.load("look", number),)
        for index in wanted[number]
    ]
    groups = tuple(sorted({each.group for each in looked}))
    numbers = np.array([groups.index(each.group) for each in looked])
    found = {name: pooled(normal_of(looked, index), numbers, memory_s) for index, name in enumerate(start.spaces)}
    return found, groups


def _written(
    parts: _Parts,
    chunks: int,
    folder: str,
    question: Question,
    start: Start,
    populations: Mapping[str, Population],
    groups: Sequence[tuple[str, ...]],
) -> FleetFit:
    """The model files, the table with each unit's improbability, and the population."""
    models = os.path.join(folder, "models")
    os.makedirs(models, exist_ok=True)
    rows = []
    for number in range(chunks):
        for each in parts.load("fit", number):
            rows.append(each.row)
            if each.model is not None:
                write_whole(os.path.join(models, f"{quote(each.row['unit'], safe=' ')}.json"), each.model.encode())
    names, _, _ = start.spaces[MAIN].parameters
    table = table_of(rows, question.within, names)
    good = (table["status"] != FAILED).to_numpy()
    squares = table.loc[good, ["distance", "leverage", "misfit_degC2"]].to_numpy(dtype=float).T
    errors = table.loc[good, "rmse_pooled_degC"].to_numpy(dtype=float) ** 2
    table["improbability"] = np.nan
    table.loc[good, "improbability"] = improbability(*squares, errors)
    save_table(os.path.join(folder, "fleet.parquet"), table)
    population = populations[MAIN]
    said = {
        "units": int(good.sum()),
        "learnt_from": population.units,
        "memory_s": population.memory_s,
        "noise_degC": float(np.sqrt(population.variance_degC2)),
        "between_units_degC": float(np.sqrt(np.trace(population.between))),
    }
    write_whole(os.path.join(folder, "population.json"), unseen_model(start, populations, said, parts.created).encode())
    return FleetFit(question.circuit, folder, table, population, start, tuple(groups), least_probable(table))


def _identity(question: Question, listed: Sequence[Entry]) -> str:
    """What a run's parts belong to: the units as they lie there, and all that is asked."""
    circuit = sha256_of(question.circuit) if os.path.isfile(question.circuit) else question.circuit
    asked = [
        __version__,
        circuit,
        question.by,
        question.within,
        question.sensors,
        question.effort.starts,
        question.effort.seed,
    ]
    digest = hashlib.sha256(json.dumps([CHUNK, *asked]).encode())
    for each in listed:
        digest.update(repr((each.unit, each.rows, each.reason, [piece.row_group for piece in each.pieces])).encode())
    return digest.hexdigest()


class _Parts:
    """What is done, a file a chunk; they belong to one question, and are gone when the run has ended well."""

    def __init__(self, folder: str, identity: str, resume: bool) -> None:
        self._folder = os.path.join(folder, _PARTS)
        header = os.path.join(self._folder, "run.json")
        before: dict[str, str] = {}
        with contextlib.suppress(OSError, ValueError), open(header, encoding="utf-8") as stream:
            before = json.load(stream)
        if resume and before and before.get("identity") != identity:
            problem = "what lies there was begun with other units or options"
            raise refuse(folder, "--resume", problem, "leave --resume out to begin anew, or name another folder")
        if not (resume and before):
            shutil.rmtree(self._folder, ignore_errors=True)
            now = datetime.datetime.now(datetime.timezone.utc).isoformat(timespec="seconds")
            before = {"identity": identity, "created": now}
            os.makedirs(self._folder)
            write_whole(header, json.dumps(before).encode())
        self.created = before["created"]

    def _path(self, stage: str, number: int | None) -> str:
        return os.path.join(self._folder, f"{stage}.pickle" if number is None else f"{stage}-{number:06d}.pickle")

    def load(self, stage: str, number: int | None = None) -> Any:
        """What was kept."""
        with open(self._path(stage, number), "rb") as stream:
            return pickle.load(stream)

    def _keep(self, stage: str, number: int | None, value: Any) -> None:
        write_whole(self._path(stage, number), pickle.dumps(value, protocol=5))

    def kept(self, stage: str, compute: Callable[[], Any]) -> Any:
        """What was kept of a stage, computed where it was not."""
        if not os.path.exists(self._path(stage, None)):
            self._keep(stage, None, compute())
        return self.load(stage)

    def fill(
        self,
        stage: str,
        count: int,
        engine: Engine,
        task: Callable[..., Sequence[Any]],
        arguments: Callable[[int], tuple[Sequence[Any], tuple[Any, ...]]],
        lost: Callable[[Any], Any],
        progress: Progress,
        what: str,
    ) -> None:
        """Do the chunks of a stage that are not there."""
        missing = [number for number in range(count) if not os.path.exists(self._path(stage, number))]
        done = count - len(missing)
        progress(what, done, count)
        for number, found in engine.run(task, missing, arguments, lost):
            self._keep(stage, number, found)
            done += 1
            progress(what, done, count)

    def remove(self) -> None:
        """Forget everything: the run has ended."""
        shutil.rmtree(self._folder, ignore_errors=True)


def write_whole(path: str, content: bytes) -> None:
    """Write a file, whole or not at all; what a power failure loses is computed anew."""
    temporary = f"{path}.{os.getpid()}.part"
    with open(temporary, "wb") as stream:
        stream.write(content)
    os.replace(temporary, path)
