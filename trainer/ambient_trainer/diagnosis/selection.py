"""Effects are added one after the other, each the one that gains most on held-out data, until nothing gains.

All candidates are scored by regression; the best are simulated, fitted and measured on held-out blocks. The simplest of
those that the data do not distinguish from the best is selected.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from joblib import Parallel, delayed
from numpy.typing import NDArray

from ambient_trainer.diagnosis.candidate import Candidate, Span
from ambient_trainer.diagnosis.causes import all_candidates, kind_of
from ambient_trainer.diagnosis.fit import FitResult, TrainingSet, fit_model, nuisance_columns, objective
from ambient_trainer.diagnosis.gain import Blocks, differ, gain
from ambient_trainer.diagnosis.model import Effect, Model, view
from ambient_trainer.diagnosis.record import Record
from ambient_trainer.diagnosis.result import Cause, Gain
from ambient_trainer.diagnosis.screening import Regression, Screened, refined, scored
from ambient_trainer.diagnosis.setting import setting_of
from ambient_trainer.diagnosis.terms import HeatTerm
from ambient_trainer.diagnosis.training import TrainedCircuit
from ambient_trainer.diagnosis.view import View
from ambient_trainer.estimation.noise import Noise

Array = NDArray[np.float64]
Progress = Callable[[str, int, int], None]

MOST_STEPS = 4
SIGNIFICANT = 0.01
LEAST_GAIN_CHANGE, LEAST_GAIN_MISSING, LEAST_GAIN_BUILT_IN = 0.3, 0.08, 0.03
"""By how much an effect must lower the held-out error: a change beside known-good records, in units of their residual;
what is missing, and what is built in, in units of the misfit itself. Chosen on the discovery benchmark."""
TIE_OF_WHAT_IS_LEFT, TIE_OF_WHAT_IS_GAINED, MOST_UNKNOWNS_SAVED = 0.06, 0.02, 2.5
"""For each unknown that it saves, a simpler cause may leave this share more than the best, or gain this share less."""
TIE_OF_A_FAULT = 0.97
LEAST_OF_LATER_STEPS, LEAST_OF_WHAT_IS_LEFT = 0.15, 0.3
"""The least gain of a later step, as a share of the first step's: what is left of an imperfect effect is no other.

At another place, it is this share of what the others leave beyond the noise.
"""
_COARSE = 60
_EDGE = 0.5
_REFINED = 24
_SIMULATED, _SIMULATED_WITH_CIRCUIT = 8, 6
_ROUNDS = 6


@dataclass(frozen=True)
class Trial:
    """A candidate that was simulated: the model with it, its errors by block, and its gain."""

    effect: Effect
    fitted: FitResult
    blocks: Blocks
    gain: Gain
    relative: float
    """By how much it lowers the held-out error, each sensor's in units of what a good simulation leaves."""

    left: float
    """The held-out error that remains, in the same units."""

    @property
    def cause(self) -> Cause:
        """What it stands for."""
        return self.effect.candidate.cause

    @property
    def places(self) -> frozenset[str]:
        """The nodes that it is at, a sensor being where its node is; none where it is everywhere."""
        plant = self.fitted.model.plant
        read = {sensor: plant.nodes[node] for sensor, node in zip(plant.sensors, plant.reads)}
        return frozenset(read.get(name, name) for name in (self.cause.place or "").split("-") if name)

    @property
    def unknowns(self) -> float:
        """How much freedom it takes."""
        edges = (self.effect.onset_s is not None) + (self.effect.end_s is not None)
        return self.effect.candidate.free + (self.effect.candidate.shape is not None) + _EDGE * edges + self._cools

    @property
    def _cools(self) -> bool:
        """Whether it removes heat at any temperature, which takes a machine."""
        if not kind_of(self.cause).one_sign:
            return False
        seen = self.fitted.longest
        term = self.effect.candidate.terms(seen)[0]
        assert isinstance(term, HeatTerm)
        return bool(float(self.effect.values[0]) * float((self.effect.window(seen.record) * term.weight).mean()) < 0.0)

    def accepted(self, least: float) -> bool:
        """Whether it is significant, surely gains, and gains enough to matter."""
        gains = self.gain.p_value < SIGNIFICANT and self.gain.ci95_degC[0] > 0 and self.relative >= least
        return gains and (self.effect.candidate.fixed[0] is not None or self._is_there)

    @property
    def _is_there(self) -> bool:
        """Whether the interval of its first coefficient excludes zero."""
        deviation = float(np.sqrt(max(self.effect.covariance[0, 0], 0.0)))
        return bool(abs(self.effect.values[0]) > 1.96 * deviation)


@dataclass(frozen=True)
class SelectionStep:
    """One step: the trial that was taken, those it cannot be prior_rows from, and all trials, best first."""

    selected: Trial | None
    rivals: tuple[Trial, ...]
    trials: tuple[Trial, ...]
    tried: int
    before: Blocks


@dataclass(frozen=True)
class Selection:
    """All steps, and the model with their effects."""

    steps: tuple[SelectionStep, ...]
    plain: FitResult
    final: FitResult
    noise: Noise
    views: tuple[tuple[View, ...], ...]
    """After each step."""


def _count(candidate: Candidate, onset_s: float | None, end_s: float | None) -> float:
    """How many coefficients, shapes and edges of the window."""
    return candidate.free + (candidate.shape is not None) + (onset_s is not None) + (end_s is not None)


def known_good_model(trained: TrainedCircuit, normal: Sequence[Record]) -> Model:
    """What the circuit needs besides to describe known-good records; it then belongs to the model."""
    found = select_effects(trained, normal, wanted=BUILT_IN)
    effects = tuple(replace(effect, known=True) for effect in found.final.model.effects)
    return replace(found.final.model, effects=effects)


def _built_in(candidate: Candidate) -> Candidate | None:
    return replace(candidate, span=Span.WHOLE) if kind_of(candidate.cause).built_in else None


def _every_cause(candidate: Candidate) -> Candidate | None:
    return candidate


@dataclass(frozen=True)
class Criterion:
    """The candidates that are ``allowed``, and the ``least`` gain, in units of the noise.

    At the places of effects that were selected before, ``found``, a further one must gain more: ``least_there``.
    """

    allowed: Callable[[Candidate], Candidate | None]
    least: float
    found: frozenset[str] = frozenset()
    least_there: float = 0.0

    def least_of(self, trial: Trial) -> float:
        """The least gain of a trial."""
        return max(self.least, self.least_there) if trial.places & self.found else self.least


CHANGE = Criterion(_every_cause, LEAST_GAIN_CHANGE)
MISSING = Criterion(_every_cause, LEAST_GAIN_MISSING)
BUILT_IN = Criterion(_built_in, LEAST_GAIN_BUILT_IN)


def select_effects(
    trained: TrainedCircuit,
    own: Sequence[Record],
    progress: Progress | None = None,
    wanted: Criterion | None = None,
) -> Selection:
    """Forward selection of effects in the diagnosed records; by default of every cause."""
    wanted = wanted or (CHANGE if trained.normal else MISSING)
    noise = trained.noise
    current = fit_model(trained.model, trained.training(own, noise), _ROUNDS)
    plain = current
    steps: list[SelectionStep] = []
    views: list[tuple[View, ...]] = []
    for step in range(MOST_STEPS):
        if steps and steps[0].selected is not None and wanted is not BUILT_IN:
            excess = Blocks.of(current, noise).relative(noise) - 1.0
            of_first = LEAST_OF_LATER_STEPS * steps[0].selected.relative
            least = max(wanted.least, min(of_first, LEAST_OF_WHAT_IS_LEFT * excess))
            found = frozenset().union(*(each.selected.places for each in steps if each.selected is not None))
            # the least gain never falls from step to step
            wanted = replace(wanted, least=least, found=found, least_there=of_first)
        steps.append(_next_step(current, trained, own, noise, wanted, _stage(progress, step)))
        if (selected := steps[-1].selected) is None:
            break
        current = selected.fitted
        if not trained.normal:
            noise = Noise.of([each.residual_degC for each in current.views])
            current = fit_model(current.model, trained.training(own, noise), _ROUNDS)
        views.append(current.views)
    return Selection(tuple(steps), plain, current, noise, tuple(views))


def _stage(progress: Progress | None, step: int) -> Callable[[int, int], None]:
    def show(done: int, total: int) -> None:
        if progress is not None:
            progress(f"step {step + 1}", done, total)

    return show


def _next_step(
    current: FitResult,
    trained: TrainedCircuit,
    own: Sequence[Record],
    noise: Noise,
    wanted: Criterion,
    progress: Callable[[int, int], None],
) -> SelectionStep:
    """All candidates beside ``current`` screened, the best simulated, and the simplest of the best selected."""
    training = trained.training(own, noise)
    start = _at_trained(current, trained, training)
    candidates = _candidates(current, trained, wanted)
    onsets, step_s = _onsets(own, trained.model.plant.period_s)
    most = _SIMULATED if trained.normal else _SIMULATED_WITH_CIRCUIT
    counted = len(candidates) + most
    regression = _regression(start, trained, training)
    screened = _screened(regression, candidates, onsets, lambda done: progress(done, counted))
    best = sorted((refined(regression, each, step_s) for each in screened), key=lambda each: -each.score)[:most]
    before = Blocks.of(current, noise)
    tries = len(candidates) * len(onsets)
    models = (start.model, current.model)
    # by as many processes as the caller has configured
    done = Parallel(return_as="generator", max_nbytes=None)(
        delayed(_trial)(models, each, training, before, tries, not trained.normal) for each in best
    )
    trials = []
    for index, trial in enumerate(done):
        progress(len(candidates) + index, counted)
        if np.isfinite(trial.fitted.square) and bool(trial.effect.candidate.plausible(trial.effect.values)):
            trials.append(trial)
    trials.sort(key=lambda each: float(each.blocks.white.sum()))
    selected, rivals = _simplest(trials, before, wanted)
    return SelectionStep(selected, rivals, tuple(trials), tries, before)


def _candidates(current: FitResult, trained: TrainedCircuit, wanted: Criterion) -> list[Candidate]:
    """The allowed candidates whose cause is not at that place already."""
    setting = setting_of(current.model, current.views, not trained.normal)
    effects = [effect.candidate.cause for effect in current.model.effects if not effect.known]
    there = {(cause.name, cause.location) for cause in effects}
    allowed = (each for each in map(wanted.allowed, all_candidates(setting)) if each is not None)
    return [each for each in allowed if (each.cause.name, each.cause.location) not in there]


def _onsets(own: Sequence[Record], period_s: float) -> tuple[list[float], float]:
    """The coarse grid of onsets, on samples (an edge between two is shared by both, and scores otherwise); its step."""
    first, last = min(float(each.time_s[0]) for each in own), max(float(each.time_s[-1]) for each in own)
    step_s = max((last - first) / _COARSE, 2 * period_s)
    steps = np.arange(step_s, last - first - step_s / 2, step_s)
    return [first + period_s * round(each / period_s) for each in steps], step_s


def _screened(
    regression: Regression, candidates: Sequence[Candidate], onsets: Sequence[float], progress: Callable[[int], None]
) -> list[Screened]:
    """The best-scored candidates; of the forms of a cause the best with each number of coefficients."""
    best: dict[tuple[Cause, int], Screened] = {}
    for index, candidate in enumerate(candidates):
        progress(index)
        result = scored(regression, candidate, onsets)
        key = candidate.cause, candidate.free
        if result is not None and (key not in best or result.score > best[key].score):
            best[key] = result
    return sorted(best.values(), key=lambda each: -each.score)[:_REFINED]


def _at_trained(current: FitResult, trained: TrainedCircuit, training: TrainingSet) -> FitResult:
    """``current`` at the trained parameters: what they have moved since may belong to the next effect."""
    if not trained.normal:
        return current
    own = tuple(effect for effect in current.model.effects if not effect.known)
    return fit_model(replace(trained.model, effects=(*trained.model.effects, *own)), training, 0)


def _trial(
    models: Sequence[Model], found: Screened, training: TrainingSet, before: Blocks, tries: int, free: bool
) -> Trial:
    """``found`` added to the one of ``models`` that is then nearer, and fitted together with it."""
    values = found.candidate.start(found.values)
    if free:
        # its coefficients go with parameters that have yet to move: they start, together, from where the model stands
        values = np.array([0.0 if fixed is None else fixed for fixed in found.candidate.fixed])
    unsure = np.zeros((len(values) + 1,) * 2)
    effect = Effect(found.candidate, found.onset_s, found.end_s, values, unsure)
    nearest = min((model.with_effect(effect) for model in models), key=lambda each: objective(each, training))
    result = fit_model(nearest, training, _ROUNDS)
    after = Blocks.of(result, training.noise)
    effect = result.model.effects[-1]
    count = _count(found.candidate, found.onset_s, found.end_s)
    left = after.relative(training.noise)
    return Trial(effect, result, after, gain(before, after, count, tries), before.relative(training.noise) - left, left)


def _simplest(trials: Sequence[Trial], before: Blocks, wanted: Criterion) -> tuple[Trial | None, tuple[Trial, ...]]:
    """The simplest acceptable trial that is about as good as the best, and those that cannot be prior_rows from it."""
    accepted = [each for each in trials if each.accepted(wanted.least_of(each))]
    if not accepted:
        return None, ()
    best = accepted[0]
    most = float((before.white - best.blocks.white).sum())
    simpler = [each for each in accepted if each.unknowns < best.unknowns and _tied(each, best, before, wanted.least)]
    taken = min(simpler, key=lambda each: (each.unknowns, float(each.blocks.white.sum()))) if simpler else best
    alike = [each for each in accepted if abs(differ(each.blocks, taken.blocks)) < 2.0]
    taken = min((each for each in alike if each.unknowns == taken.unknowns), key=lambda each: each.gain.rmse_after_degC)
    rivals = [each for each in alike if each.cause != taken.cause]
    # heat that no neighbour feels is not distinguishable from a faulty sensor, which needs no heat
    faults = [
        each
        for each in rivals
        if each.effect.sensors
        and each.unknowns <= taken.unknowns
        and (before.white - each.blocks.white).sum() >= TIE_OF_A_FAULT * most
    ]
    neighbours = len(best.fitted.model.plant.reads) > 1
    if faults and neighbours and not taken.effect.sensors:
        rivals = [taken, *(each for each in rivals if each is not faults[0])]
        taken = faults[0]
    return taken, tuple(rivals)


def _tied(simpler: Trial, best: Trial, before: Blocks, least: float) -> bool:
    """Whether a simpler cause is about as good as the best: by what is left, or by what is gained."""
    saved = min(best.unknowns - simpler.unknowns, MOST_UNKNOWNS_SAVED)
    if simpler.left <= best.left * (1.0 + TIE_OF_WHAT_IS_LEFT * saved):
        return True
    gained, most = (float((before.white - each.blocks.white).sum()) for each in (simpler, best))
    # a smaller form of the same cause has to leave as little
    return simpler.cause != best.cause and (
        gained >= most * (1.0 - TIE_OF_WHAT_IS_GAINED * saved) and best.relative - simpler.relative < least
    )


def _regression(current: FitResult, trained: TrainedCircuit, training: TrainingSet) -> Regression:
    noise = training.noise
    normal = None
    if trained.normal:
        model = trained.model
        before = [view(model, record) for record in trained.normal]
        normal = Regression.of(before, noise)
    free, prior_rows = nuisance_columns(current, training)
    return Regression.of(current.views, noise, free, prior_rows, normal)
