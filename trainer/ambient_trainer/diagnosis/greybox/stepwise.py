"""Mechanisms are added one at a time: screened by a score test, fitted jointly, compared on held-out blocks of time.

The score test takes each candidate's first-order effect on the *simulated* sensors, projects out what the model's own
numbers could do as well, and solves for its amount (Rao 1948). Measured temperatures are never regressors.
"""

from __future__ import annotations

import logging
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from joblib import Parallel, delayed
from scipy.linalg import block_diag
from threadpoolctl import threadpool_limits

from ambient_model.faults import refuse
from ambient_trainer.data.plugins import plugin, plugin_names
from ambient_trainer.data.trace import Array
from ambient_trainer.diagnosis.greybox.model import GreyBox, Mechanism
from ambient_trainer.diagnosis.greybox.network import Network
from ambient_trainer.diagnosis.greybox.regression import EACH, LEFT_OUT, Fitted, Prior, fit
from ambient_trainer.diagnosis.greybox.scene import Scene
from ambient_trainer.diagnosis.greybox.windows import Columns, best_window, best_windows, sharpened
from ambient_trainer.diagnosis.record import Record

_log = logging.getLogger(__name__)
_MECHANISMS = f"{__package__}.mechanisms"

LEAST_GAIN, PENALTY = 0.05, 0.04
"""Of the held-out error's logarithm, altogether and by complexity: a step that gains less is curve fitting."""
INSTRUMENT, _HALF = 1.3, 0.5
_SHORTLIST, _DRIVERS, _STARTS = 6, 10, 4
_FEW, _MANY, _FINALISTS = 5, 25, 4
_HOPELESS = 0.25
MOST_STEPS = 6
_LOOPED = 2500
_SURE, _SURELY, _WITHIN = 1.645, 1.96, 100.0
_BELOW_FLOOR = 0.55
_LASTING, ANSWERS, COINCIDE = 1.3, 1.5, 0.6
_PLACED = 2
_PAIRED, _LITTLE, _ABOVE_FLOOR = 4, 0.7, 2.0
_SHAKEN = 1.5
"""Times the error of folds, which a window that is no finding makes worse: chosen on a measured heater block."""
_BESIDE, _NEAR = 3, 8
"""Samples on each side of a jump, and how far it may be from the end of a window, which a grid has placed."""
_ELECTRIC = re.compile(r"_(A|V|As|Ah|W|kW|C|ohm)\b")
"""What carries charge or heat moves no air."""


@dataclass(frozen=True)
class Screened:
    """A candidate by the score test: as it would start, and the sum of squares that is held out."""

    mechanism: Mechanism
    held_out: float
    point: Fitted
    """The model beside which it was screened."""


@dataclass(frozen=True)
class Trial:
    """A candidate that was fitted jointly with all numbers."""

    mechanism: Mechanism
    fitted: Fitted
    rmse_degC: float
    """Held-out."""
    at_bounds: bool
    """Whether a number of it ends at a physical bound, or an earlier amount that had stood free."""

    @property
    def lasting(self) -> bool:
        """Whether it acts all the time."""
        return self.mechanism.lasts

    @property
    def identified(self) -> bool:
        """Whether its numbers are."""
        return identified(self.fitted, len(self.fitted.model.mechanisms) - 1)

    @staticmethod
    def of(before: Fitted, after: Fitted) -> Trial:
        """The last mechanism of ``after``; one that acts for a while is scored on short stretches."""
        mechanism, error = after.model.mechanisms[-1], after.held_out_rmse_degC
        if not mechanism.lasts:
            error = before.held_out_rmse_degC * float(np.sqrt(after.combed.sum() / before.combed.sum()))
        # an earlier time constant may well turn out to be longer than the record
        new = after.at_bounds - before.at_bounds
        numbers, own = after.model.numbers, len(after.model.numbers) - len(mechanism.numbers)
        bounded = any(index >= own or not numbers[index].log for index in new)
        return Trial(mechanism, after, error if np.isfinite(error) else float("inf"), bounded)


def identified(fitted: Fitted, index: int) -> bool:
    """Whether an amount of a mechanism is surely not zero, of heat each, or its conductance is known within a factor of
    a hundred."""
    mechanism = fitted.model.mechanisms[index]
    first = len(fitted.model.own) + sum(len(each.numbers) for each in fitted.model.mechanisms[:index])
    variance = np.diag(fitted.covariance)[first : first + len(mechanism.numbers)]
    deviations = np.sqrt(np.maximum(variance, 0.0))
    amounts = [abs(n.z) > _SURELY * sd for n, sd in zip(mechanism.numbers, deviations) if not n.log]
    if mechanism.cause == "heat_source":
        return all(amounts)
    return any(amounts) or (mechanism.numbers[0].log and bool(_SURELY * deviations[0] < np.log(_WITHIN)))


@dataclass(frozen=True)
class Step:
    """One step: the model before and after, and all trials, best first."""

    before: Fitted
    chosen: Trial | None
    trials: tuple[Trial, ...]
    tried: int
    """Candidates that were screened."""


@dataclass(frozen=True)
class Selection:
    """The circuit by itself, the model with what it lacked, and the steps between; the last may have chosen nothing.

    ``compared`` is the first step with every candidate by itself, whatever was added together.
    """

    bare: Fitted
    final: Fitted
    steps: tuple[Step, ...]
    compared: Step


@dataclass(frozen=True)
class Limits:
    """Held-out errors: below ``floor_degC``, which a black box leaves, only large gains count; ``least_degC`` is what
    every step has to gain."""

    floor_degC: float = 0.0
    least_degC: float = 0.0


Progress = Callable[[str, int, int], None]
Offered = Callable[[Scene, Columns], Iterator[Mechanism]]


def lasting_candidates(scene: Scene, columns_of: Columns) -> Iterator[Mechanism]:
    """Those of every kind of mechanism that may act all the time."""
    yield from _offered(scene, "candidates")


def every_candidate(scene: Scene, columns_of: Columns) -> Iterator[Mechanism]:
    """Those, and those that may act for a while, each in its best window, and what else may act in that."""
    yield from lasting_candidates(scene, columns_of)
    yield from _placed(scene, columns_of, _offered(scene, "windowed"))
    yield from _placed(scene, columns_of, _offered(scene, "alone"))


def changed_candidates(scene: Scene, columns_of: Columns) -> Iterator[Mechanism]:
    """Those, and what may have changed for good or begun on a device that known-good records hold."""
    windowed = _placed(scene, columns_of, _offered(scene, "windowed"))
    yield from (each for each in (*lasting_candidates(scene, columns_of), *windowed) if not each.structural)
    yield from _offered(scene, "windowed")
    yield from _offered(scene, "changed")
    yield from _placed(scene, columns_of, _offered(scene, "begun"))


def _offered(scene: Scene, how: str) -> Iterator[Mechanism]:
    """What the kinds of mechanism offer by a function of that name."""
    for name in plugin_names(_MECHANISMS):
        yield from getattr(plugin(_MECHANISMS, name), how, lambda scene: ())(scene)


def _placed(scene: Scene, columns_of: Columns, offered: Iterable[Mechanism]) -> Iterator[Mechanism]:
    """Each in its best windows, and what else may act in those."""
    for each in offered:
        for placed in best_windows(scene.fitted, each, columns_of):
            yield placed
            for name in plugin_names(_MECHANISMS):
                beside = getattr(plugin(_MECHANISMS, name), "beside", None)
                yield from () if beside is None else beside(scene, placed)


def screen(scene: Scene, offered: Offered) -> list[Screened]:
    """Candidates of ``offered`` by what they would leave on held-out blocks, to first order; best first."""
    fitted = scene.fitted
    columns_of = _columns_of(fitted)
    result = []
    for each in offered(scene, columns_of):
        columns = columns_of(each)
        if not np.isfinite(columns).all() or not columns.any():
            continue
        amounts, squares = _scored(fitted, columns, each.lasts)
        started = each.started([float(amount) for amount in amounts])
        if started is not None and np.isfinite(squares):
            result.append(Screened(started, squares, fitted))
    return sorted(result, key=lambda each: each.held_out)


def _columns_of(fitted: Fitted) -> Columns:
    """What each probe of a mechanism adds to the sensors beside a fit, (M, k)."""
    beside = [_Beside(fitted.model, record, run.start) for record, run in zip(fitted.records, fitted.runs)]
    return lambda mechanism: np.concatenate([each.effect(mechanism) for each in beside])


class _Beside:
    """A model on a record, whose own heat and losses stay as they are along its simulation."""

    def __init__(self, model: GreyBox, record: Record, start: Array) -> None:
        self.model, self.record, self.start = model, record, start
        network = model.network(record, model.z()[None])
        self.nodes = network.nodes_degC(start[None])[0]
        self.read = network.read(self.nodes[None])[0]
        self._frozen: dict[int, Network] = {}

    def effect(self, mechanism: Mechanism) -> Array:
        """What each probe of a mechanism adds to the sensors, (M, k)."""
        probes = np.array(mechanism.probes(), dtype=float)
        network = self._network(len(probes))
        mechanism.apply(network, probes, self.record)
        first = np.full((len(probes), len(network.nodes)), self.start[network.reads].mean())
        first[:, : len(self.start)] = self.start
        valid = np.isfinite(self.record.sensors)
        return np.asarray((self.record.weights * (network.simulate(first) - self.read))[:, valid].T)

    def _network(self, lanes: int) -> Network:
        if lanes not in self._frozen:
            self._frozen[lanes] = self.model.network(self.record, np.repeat(self.model.z()[None], lanes, axis=0))
            self._frozen[lanes].frozen(self.nodes)
        return self._frozen[lanes].copied()


def _scored(fitted: Fitted, S: Array, lasts: bool) -> tuple[Array, float]:
    """The amounts (k,) of columns S (M, k) beside the model's own slopes, and the held-out sum of squares with them.

    What acts for a while is left out in short stretches, and its gain on them is taken for that on folds.
    """
    parts, left_out = (fitted.by_fold, LEFT_OUT) if lasts else (fitted.by_comb, EACH)
    full = parts.beside(S)
    own = full.H.shape[1] - S.shape[1]
    size = np.concatenate([np.ones(own), 1.0 / (np.sqrt((S**2).sum(axis=0)) + 1e-300)])
    ridge = block_diag(fitted.ridge(), 1e-9 * np.eye(S.shape[1]))
    sized = full.scaled(size)
    solution = np.linalg.lstsq(sized.H.sum(axis=0) + ridge, sized.g.sum(axis=0), rcond=1e-12)[0]
    amounts = (solution * size)[own:]
    # the candidate's own coordinate is its amount: a fold that is left out may change it as much as it likes
    scaled = sized.moved(solution).scaled(np.concatenate([np.ones(own), np.abs(amounts) / size[own:]]))
    squares = float(scaled.held_out(ridge, left_out).sum())
    return amounts, squares if lasts else squares * float(fitted.held_out.sum() / fitted.combed.sum())


def shortlist(screened: Sequence[Screened]) -> list[Screened]:
    """The best overall, the best of every cause with and without a driver, and of every driver."""
    distinct: dict[tuple[object, ...], Screened] = {}
    for each in screened:
        mechanism = each.mechanism
        point = id(each.point) if mechanism.shaped else 0
        bounded = _ends(mechanism)
        distinct.setdefault((type(mechanism), mechanism.key, len(mechanism.numbers), point, bounded), each)
    ordered = list(distinct.values())
    chosen = ordered[:_SHORTLIST]
    seen: dict[tuple[str, object], int] = {}
    started: dict[tuple[object, ...], int] = {}
    for each in ordered:
        cause, _, driver = each.mechanism.key
        windowed = _ends(each.mechanism)
        numbers = len(each.mechanism.numbers) * each.mechanism.shaped
        kinds: list[tuple[str, object]] = [("cause", (sum(windowed), type(each.mechanism), driver == "", numbers))]
        if any(windowed) and cause == "heat_source":
            kinds.append(("where", each.mechanism.places))
        shape = (type(each.mechanism), len(each.mechanism.places), len(each.mechanism.numbers))
        if each.mechanism.shaped and started.get(shape, 0) < _STARTS:
            started[shape] = started.get(shape, 0) + 1
            chosen.append(each)
        scope = "driver of one" if len(each.mechanism.places) == 1 else "driver of several"
        scope = "tuned " * each.mechanism.tuned + scope
        if driver and "*" not in driver and len([key for key in seen if key[0] == scope]) < _DRIVERS:
            kinds.append((scope, (cause, driver)))
        for kind in kinds:
            seen[kind] = seen.get(kind, 0) + 1
            if seen[kind] == 1:
                chosen.append(each)
    return list({id(each): each for each in chosen}.values())


def _ends(mechanism: Mechanism) -> tuple[bool, bool]:
    """Whether it begins, and whether it ends, within the record."""
    return mechanism.onset_s is not None, mechanism.end_s is not None


def compared(before: Fitted, screened: Sequence[Screened], progress: Callable[[int, int], None]) -> list[Trial]:
    """Joint fits with each candidate from where it was screened, best first: a few steps for all, more for the best.

    They run side by side in as many processes as joblib is configured for.
    """
    total = len(screened) + _FINALISTS
    begun = [(each.point.model.with_mechanism(each.mechanism), each.point) for each in screened]
    trials: list[Trial] = []
    for done, result in enumerate(_side_by_side(_refit, begun, _FEW)):
        progress(done, total)
        if result is not None:
            trials.append(Trial.of(before, result))
    known = {each.mechanism.key for each in trials}
    heating = [(each, less) for each in trials if (less := _where_it_heats(each)) and less.key not in known]
    fewer = [(before.model.with_mechanism(less), each.fitted) for each, less in heating]
    trials += [Trial.of(before, each) for each in _side_by_side(_refit, fewer, _FEW) if each is not None]
    trials.sort(key=promise)
    worth = [each for each in trials[:_FINALISTS] if promise(each) < promise(trials[0]) + _HOPELESS]
    finalists = [(each.fitted.model, each.fitted) for each in worth]
    for index, result in enumerate(_side_by_side(_refit_and_validate, finalists, _MANY)):
        progress(len(screened) + index, total)
        if result is not None:
            trials[index] = Trial.of(before, result)
    return sorted(trials[: len(worth)], key=penalised) + sorted(trials[len(worth) :], key=penalised)


def _side_by_side(
    function: Callable[..., Fitted | None], tasks: Sequence[tuple[GreyBox, Fitted]], most: int
) -> Iterator[Fitted | None]:
    calls = (
        delayed(function)(model, near.records, [run.start for run in near.runs], near.prior, most)
        for model, near in tasks
    )
    results: Iterator[Fitted | None] = Parallel(return_as="generator", max_nbytes=None)(calls)
    return results


def _refit(
    model: GreyBox, records: Sequence[Record], starts: Sequence[Array], prior: Prior, most: int
) -> Fitted | None:
    linear = not model.network(records[0], model.z()[None]).nonlinear
    with threadpool_limits(1):
        # without a loop over samples steps cost little, and valleys are followed to their ends
        most, tolerance = (4 * most, 5e-4) if linear else (most, 3e-3)
        return fit(model, records, starts, most=most, tolerance=tolerance, prior=prior)


def _refit_and_validate(*given: Any) -> Fitted | None:
    done = _refit(*given)
    if done is None:
        return None
    with threadpool_limits(1):
        if not (done.model.mechanisms[-1].lasts or done.model.mechanisms[-1].evident):
            done = sharpened(_placed_again(done))
        return done.refitted() if _cheap(done) else done


def _placed_again(fitted: Fitted) -> Fitted:
    """The same with the window of its last mechanism placed anew beside its other numbers, which it has moved."""
    for _ in range(_PLACED):
        model, last = fitted.model.without(len(fitted.model.mechanisms) - 1), fitted.model.mechanisms[-1]
        starts = [run.start for run in fitted.runs]
        beside = fit(model, fitted.records, starts, most=0, prior=fitted.prior)
        if beside is None:
            break
        window = best_window(beside, last, _columns_of(beside), closed=all(_ends(last)))
        if window is None or window == last or _ends(window) != _ends(last):
            break
        again = fit(model.with_mechanism(window), fitted.records, starts, most=_FEW, tolerance=3e-3, prior=fitted.prior)
        if again is None or again.rmse_degC > fitted.rmse_degC:
            break
        fitted = again
    return fitted


def _cheap(fitted: Fitted) -> bool:
    """Whether folds can be left out in earnest: without a loop over samples, or with few of them."""
    network = fitted.model.network(fitted.records[0], fitted.model.z()[None])
    return not network.nonlinear or sum(record.samples for record in fitted.records) < _LOOPED


def promise(trial: Trial) -> float:
    """Which trials are worth a full fit: by the error in sample, since few steps make the held-out one unsure."""
    return float(np.log(trial.fitted.rmse_degC)) + PENALTY * complexity(trial.mechanism)


def complexity(mechanism: Mechanism) -> float:
    """How much a mechanism assumes: its numbers, its driver's parts, and whether it blames an instrument."""
    text = "" if mechanism.driver is None else mechanism.driver.text
    joule = text.endswith("_A^2")
    driver = (
        0.5 * bool(text)
        + 1.0 * (not text and mechanism.key[0] == "heat_source" and mechanism.onset_s is None)
        + 1.0 * (mechanism.cause == "heat_source") * (len(mechanism.places) - 1)
        + 3.0 * (text.endswith("_A") and mechanism.cause == "heat_source")
        + 1.5 * text.count("*")
        + 0.5 * text.count("/dt")
        + 2.5 * mechanism.tuned
        + 0.5 * (text.count("^") - joule)
    )
    electric = 3.0 * (mechanism.cause == "ambient_coupling" and bool(_ELECTRIC.search(text)))
    bounds = 2.5 * ((mechanism.onset_s is not None) + (mechanism.end_s is not None))
    return 0.5 + mechanism.assumes + 0.5 * len(mechanism.numbers) + driver + electric + bounds


def penalised(trial: Trial) -> float:
    """The logarithm of the held-out error, and what a mechanism assumes."""
    return float(np.log(trial.rmse_degC)) + PENALTY * complexity(trial.mechanism)


def choose(before: Fitted, trials: Sequence[Trial], least_degC: float) -> Trial | None:
    """The trial with the least penalised error; None where none gains enough. Physics goes before instruments.

    But what shows itself in the readings alone, a sensor that stands still while all else moves, comes first.
    """
    ordered = sorted((each for each in trials if not each.at_bounds), key=penalised)
    for each in ordered:
        if each.mechanism.evident and _halves(before, each):
            return each
    passing = [each for each in ordered if gains(before, each, least_degC) and each.identified and _jumps(each)]
    physical = [each for each in passing if not each.mechanism.instrument]
    # what a logged driver explains may lie within one fold
    driven = [each for each in ordered if not each.mechanism.instrument and each.mechanism.driver is not None]
    driven = [each for each in driven if each.rmse_degC < _HALF * before.held_out_rmse_degC]
    blamed = _blamed([each for each in passing if each.mechanism.instrument])
    if blamed is not None:
        # a clock that is off looks like nothing else: there it is enough to do better than all physics, sound or not
        clock = not blamed.mechanism.places
        rivals = [each for each in trials if not each.mechanism.instrument] if clock else [*physical, *driven]
        better = all(blamed.rmse_degC * INSTRUMENT < each.rmse_degC for each in rivals)
        if better and (clock or _halves(before, blamed)):
            return blamed
    # another temperature that is logged may answer to the same cause: it has to explain much more
    given = [each for each in physical if not each.mechanism.responds]
    otherwise_degC = given[0].rmse_degC if given else before.held_out_rmse_degC
    if physical and otherwise_degC < ANSWERS * physical[0].rmse_degC:
        physical = given
    return _lasting(physical, driven, least_degC) if physical else None


def _blamed(instruments: Sequence[Trial]) -> Trial | None:
    """Of the sensor that the first one blames the fault that leaves least there: elsewhere they change nothing."""
    alike = [each for each in instruments if each.mechanism.places == instruments[0].mechanism.places]
    return min(alike, key=_penalised_at_its_sensor, default=None)


def _penalised_at_its_sensor(trial: Trial) -> float:
    return float(np.log(sensor_rmse_degC(trial.fitted, trial))) + PENALTY * complexity(trial.mechanism)


def _plainest(ordered: Sequence[Trial], least_degC: float) -> Trial:
    """The first, unless the same law with fewer numbers is there and they gain less than a step has to."""
    first = ordered[0]
    for each in ordered[1:]:
        same = each.mechanism.key == first.mechanism.key and each.lasting == first.lasting
        if same and len(each.mechanism.numbers) < len(first.mechanism.numbers):
            enough = penalised(first) < penalised(each) - LEAST_GAIN and first.rmse_degC < each.rmse_degC - least_degC
            return first if enough else each
    return first


def _lasting(ordered: Sequence[Trial], driven: Sequence[Trial], least_degC: float) -> Trial:
    """The first, unless it acts for a while and what acts all the time does nearly as well by the same measure, or one
    of ``driven`` acted at that time."""
    first = _plainest(ordered, least_degC)
    if first.lasting:
        return first
    error = float(np.sqrt(first.fitted.combed.sum()))
    logged = (each for each in driven if _coincide(first, each))
    alike = (each for each in ordered if each.lasting and np.sqrt(each.fitted.combed.sum()) < _LASTING * error)
    return next(logged, next(alike, first))


def _coincide(window: Trial, logged: Trial) -> bool:
    """Whether a window in which nothing logged acts is about when a logged driver of the same cause acted."""
    if (window.mechanism.cause, window.mechanism.places) != (logged.mechanism.cause, logged.mechanism.places):
        return False
    return correlation(window.mechanism, logged.mechanism, window.fitted.records) > COINCIDE


def correlation(one: Mechanism, other: Mechanism, records: Sequence[Record]) -> float:
    """Of what drives two mechanisms; 0 where either is there all the time."""
    rows = np.array([np.concatenate([each.weight(record) for record in records]) for each in (one, other)])
    return float(np.corrcoef(rows)[0, 1]) if np.ptp(rows, axis=1).all() else 0.0


def _jumps(trial: Trial) -> bool:
    """Whether readings jump where an offset of a sensor begins and ends: what warms or cools takes its time."""
    mechanism = trial.mechanism
    if not mechanism.sudden:
        return True
    amount = mechanism.numbers[0].value
    sensor = [output.name for output in trial.fitted.model.circuit.outputs].index(mechanism.places[0])
    for index, record in enumerate(trial.fitted.records):
        without = trial.fitted.residual_degC(index)[sensor] + amount * mechanism.weight(record)
        for at_s, size in ((mechanism.onset_s, amount), (mechanism.end_s, -amount)):
            if at_s is not None and record.time_s[0] < at_s < record.time_s[-1]:
                edge = int(np.searchsorted(record.time_s, at_s))
                jumps = [_jump(without, each) for each in range(edge - _NEAR, edge + _NEAR + 1)]
                if max(np.sign(size) * np.array(jumps)) < _HALF * abs(size):
                    return False
    return True


def _jump(row: Array, at: int) -> float:
    """From the samples before ``at`` to those behind it; 0 where the row has too few."""
    before, after = row[max(at - _BESIDE, 0) : max(at, 0)], row[at + 1 : at + 1 + _BESIDE]
    known = np.isfinite(before).any() and np.isfinite(after).any()
    return float(np.nanmean(after) - np.nanmean(before)) if known else 0.0


def _halves(before: Fitted, trial: Trial) -> bool:
    """Whether more than half of the error goes at the sensor that a trial blames."""
    return sensor_rmse_degC(trial.fitted, trial) < _HALF * sensor_rmse_degC(before, trial)


def sensor_rmse_degC(fitted: Fitted, trial: Trial) -> float:
    """What is left in sample at the sensor that a trial blames; at all of them for a clock."""
    sensors = [output.name for output in fitted.model.circuit.outputs]
    blamed = [sensors.index(each) for each in trial.mechanism.places] or list(range(len(sensors)))
    left = np.concatenate([fitted.residual_degC(index)[blamed] for index in range(len(fitted.records))], axis=1)
    return float(np.sqrt(np.nanmean(left**2)))


def gains(before: Fitted, after: Trial, least_degC: float) -> bool:
    """Whether a fit gains on held-out folds, by enough, and in more of them than chance would have it."""
    if penalised(after) > np.log(before.held_out_rmse_degC) - LEAST_GAIN:
        return False
    if before.held_out_rmse_degC - after.rmse_degC < least_degC:
        return False
    # of a window that is left out whole nothing is known, but the rest has to stand as it did
    if not after.lasting and after.fitted.held_out_rmse_degC > _SHAKEN * before.held_out_rmse_degC:
        return False
    by_comb = _beyond_chance(before.combed - after.fitted.combed)
    # what acts all the time may have shown itself in one fold only
    return by_comb or (after.lasting and _beyond_chance(before.held_out - after.fitted.held_out))


def _beyond_chance(apart: Array) -> bool:
    """Whether what each fold gains is surely more than nothing on the average, or most of them gain."""
    scatter = float(np.std(apart, ddof=1) / np.sqrt(len(apart)))
    return bool(apart.mean() > _SURE * scatter or (apart > 0).mean() >= 0.75)


def stepwise(
    bare: Fitted,
    beside: Sequence[Fitted] = (),
    limits: Limits = Limits(),
    progress: Progress | None = None,
    offered: Offered = every_candidate,
) -> Selection:
    """The model with what it lacks.

    The first candidates are screened at the points ``beside``, too.
    """
    said = progress or (lambda stage, done, total: None)
    fitted, given = bare, len(bare.model.mechanisms)
    steps: list[Step] = []
    alone: Step | None = None
    while len(steps) < MOST_STEPS:
        points = [fitted] if steps else [fitted, *beside]
        step = _next(fitted, points, limits, offered, partial(_numbered, said, len(steps) + 1))
        alone = alone or step
        pair = _pair(step, limits, offered, partial(_numbered, said, 1)) if beside and not steps else []
        steps += pair or [step]
        last = steps[-1].chosen
        if last is None:
            break
        _log.info("%s: %.3f -> %.3f", last.mechanism, fitted.held_out_rmse_degC, last.rmse_degC)
        fitted = pruned(last.fitted, given)
    assert alone is not None
    return Selection(bare, fitted, tuple(_logged_first(steps)), alone)


def _logged_first(steps: Sequence[Step]) -> Sequence[Step]:
    """With heat by a logged driver before heat that is there without one, where these are the first two."""
    first, second = (*(step.chosen for step in steps[:2]), None, None)[:2]
    if first is None or second is None or not (first.lasting and second.lasting):
        return steps
    heats = first.mechanism.cause == second.mechanism.cause == "heat_source"
    if not heats or first.mechanism.driver is not None or second.mechanism.driver is None:
        return steps
    return [steps[1], _beside(steps[0], first, second), *steps[2:]]


def _beside(step: Step, first: Trial, second: Trial) -> Step:
    """The step of ``first`` where ``second`` is there, too: beside the model that holds that one alone."""
    alone = (each for each in sorted(step.trials, key=penalised) if each.lasting)
    before = next((each.fitted for each in alone if each.mechanism.key == second.mechanism.key), step.before)
    together = replace(first, fitted=second.fitted, rmse_degC=second.rmse_degC)
    return Step(before, together, step.trials, step.tried)


def _numbered(said: Progress, number: int, stage: str, done: int, total: int) -> None:
    said(f"fit effect {number}: {stage}", done, total)


def _next(fitted: Fitted, points: Sequence[Fitted], limits: Limits, offered: Offered, said: Progress) -> Step:
    """One step from ``fitted``; candidates are screened beside each of ``points``."""
    screened: list[Screened] = []
    for index, point in enumerate(points):
        said("screen", index, len(points))
        screened += screen(Scene(point), lasting_candidates if index else offered)
    screened.sort(key=lambda each: each.held_out)
    trials = compared(fitted, shortlist(screened), partial(said, "try"))
    _log.debug("\n".join(f"{each.rmse_degC:.3f} {each.fitted.rmse_degC:.3f} {each.mechanism}" for each in trials))
    chosen = choose(fitted, trials, limits.least_degC)
    # what a black box leaves says nothing of readings that jump or stand still
    visible = chosen is not None and (chosen.mechanism.sudden or chosen.mechanism.evident)
    if chosen is not None and not visible and fitted.held_out_rmse_degC < limits.floor_degC:
        small = chosen.rmse_degC > _BELOW_FLOOR * fitted.held_out_rmse_degC
        chosen = None if small or chosen.mechanism.instrument else chosen
    if chosen is not None and chosen.mechanism.tuned:
        again = sharpened(chosen.fitted)
        chosen = Trial.of(fitted, again.refitted() if _cheap(again) else again)
    return Step(fitted, chosen, tuple(trials), len({each.mechanism.key for each in screened}))


def _without_a_place(mechanism: Mechanism) -> list[Mechanism]:
    """A mechanism without each of its places, where each has numbers of its own."""
    count = len(mechanism.places)
    if count < 2 or len(mechanism.numbers) % count:
        return []
    return [mechanism.at_places([each for each in range(count) if each != out]) for out in range(count)]


def _where_it_heats(trial: Trial) -> Mechanism | None:
    """Heat into several places without those whose amount is at a bound, or not surely one; None where all are."""
    mechanism, numbers = trial.mechanism, trial.mechanism.numbers
    if mechanism.cause != "heat_source" or len(mechanism.places) != len(numbers) or len(numbers) == 1:
        return None
    deviations = np.sqrt(np.maximum(np.diag(trial.fitted.covariance)[-len(numbers) :], 0.0))
    sure = [n.z > n.range_z[0] and abs(n.z) > _SURELY * sd for n, sd in zip(numbers, deviations)]
    kept = [index for index, each in enumerate(sure) if each]
    return mechanism.at_places(kept) if 0 < len(kept) < len(numbers) else None


def _pair(step: Step, limits: Limits, offered: Offered, said: Progress) -> list[Step]:
    """Two steps at once where one alone gains little, or nothing logged drives it: heat and the mass that stores it, or
    heat by a driver and what is there without it, show themselves together.

    Each is then compared with the model that holds the other alone.
    """
    error = step.before.held_out_rmse_degC
    single = error if step.chosen is None else step.chosen.rmse_degC
    chosen = None if step.chosen is None else step.chosen.mechanism
    enough = single < min(_LITTLE * error, _ABOVE_FLOOR * limits.floor_degC)
    if chosen is not None and (chosen.evident or (enough and chosen.driver is not None)):
        return []
    # heat that nothing logged drives may stand for a driver and for what is there without it, or hide it
    unlogged = chosen is None or (chosen.cause == "heat_source" and chosen.driver is None)
    begun: dict[object, Trial] = {}
    for each in [*([step.chosen] if step.chosen else []), *sorted(step.trials, key=penalised)]:
        if _stores_or_heats(each.mechanism, unlogged):
            begun.setdefault(each.mechanism.key, each)
    alone = float(np.log(error)) if step.chosen is None else penalised(step.chosen)
    best: tuple[float, Trial, Trial] | None = None
    for index, first in enumerate(list(begun.values())[:_PAIRED]):
        said("try pairs", index, _PAIRED)
        logged = first.mechanism.driver is not None
        others = [
            each
            for each in screen(Scene(first.fitted), offered if logged else lasting_candidates)
            if _stores_or_heats(each.mechanism, unlogged or logged) or (logged and _changes(each.mechanism))
        ]
        # of two heats by drivers each shows itself alone, but a driver's rate only beside it
        driven = first.mechanism.key[2]
        others = [each for each in others if each.mechanism.key != first.mechanism.key]
        others = [each for each in others if not driven or each.mechanism.key[2] in ("", f"d({driven})/dt")]
        for second in compared(first.fitted, shortlist(others), lambda done, total: None):
            score = penalised(second) + PENALTY * complexity(first.mechanism)
            before = len(second.fitted.model.mechanisms) - 2
            free = not any(
                number.at_bound for each in second.fitted.model.mechanisms[before:] for number in each.numbers
            )
            sound = free and second.identified and identified(second.fitted, before)
            if sound and first is step.chosen:
                # it is followed anyway
                alone = min(alone, score)
            elif sound and (best is None or score < best[0]):
                best = score, first, second
    if best is None or best[0] > alone - LEAST_GAIN or not gains(step.before, best[2], limits.least_degC):
        return []
    _, first, second = best
    steps = [_beside(step, first, second), Step(first.fitted, second, step.trials, step.tried)]
    # what is logged is named before what stores it
    stored_first = first.mechanism.driver is None and second.mechanism.driver is not None
    return steps[::-1] if stored_first else steps


def _stores_or_heats(mechanism: Mechanism, unlogged: bool) -> bool:
    """Whether it is heat by a driver, or ``unlogged`` by none, or a mass, all the time."""
    heat = mechanism.cause == "heat_source" and (unlogged or mechanism.driver is not None)
    return (heat or mechanism.cause == "thermal_mass") and mechanism.lasts


def _changes(mechanism: Mechanism) -> bool:
    """Whether it is a loss that is another for a while, or from some time on: what it hides looks like no heater's."""
    return mechanism.cause == "ambient_coupling" and not mechanism.lasts


def pruned(fitted: Fitted, given: int) -> Fitted:
    """The model without mechanisms, and places of heat, that later ones have made needless; the first ``given`` are the
    circuit's own."""
    model = fitted.model
    hidden = {place for each in model.mechanisms for place in each.places} - {n.name for n in model.circuit.states}
    last = len(model.mechanisms) - 1
    for index, mechanism in list(enumerate(model.mechanisms))[given:]:
        held = any(each.startswith(place) for place in mechanism.places for each in hidden)
        less = [] if held or index == last else [model.without(index)]
        if mechanism.cause == "heat_source":
            less += [model.replaced(index, each) for each in _without_a_place(mechanism)]
        for each in less:
            without = fit(each, fitted.records, [None for _ in fitted.runs], tolerance=1e-3, prior=fitted.prior)
            if without is None or without.rmse_degC > (1.0 + LEAST_GAIN) * fitted.rmse_degC:
                continue
            # both by the same measure: to first order, or by fits without each fold
            without = without if fitted.validated is None else without.refitted()
            if without.held_out_rmse_degC <= fitted.held_out_rmse_degC / (1.0 - LEAST_GAIN / 2):
                _log.info("dropped %s, or a place of it", mechanism)
                return pruned(without, given)
    return fitted


def anchors(model: GreyBox, records: Sequence[Record]) -> list[Fitted]:
    """The circuit as it is given and with time constants a factor of ten off, not fitted: where a cause that is missing
    drives the fit to absurd ones, candidates show themselves here."""
    points = (fit(_slower(model, factor), records, most=0, prior=Prior.of(model)) for factor in (1.0, 10.0, 0.1))
    return [each for each in points if each is not None]


def _slower(model: GreyBox, factor: float) -> GreyBox:
    """The model with every free time constant times ``factor``."""
    unit = "J/K" if any(each.unit == "J/K" for each in model.own) else "K/W"
    z = model.z()
    z[: len(model.own)] += [np.log(factor) if each.unit == unit else 0.0 for each in model.own]
    return model.at(z)


def bare_fit(model: GreyBox, records: Sequence[Record]) -> Fitted:
    """The circuit itself at its least squares, from several starts."""
    fits = (fit(_slower(model, factor), records, prior=Prior.of(model)) for factor in (1.0, 10.0, 0.1, 100.0))
    simulated = [each for each in fits if each is not None]
    if not simulated:
        hint = "check the units of its columns, and readings that no sensor can have"
        raise refuse("diagnose", model.circuit.name, "cannot be simulated on this trace", hint)
    return min(simulated, key=lambda each: each.rmse_degC).refitted()
