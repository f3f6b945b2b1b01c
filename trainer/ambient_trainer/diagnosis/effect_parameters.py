"""What is fitted of an effect: its free coefficients, its shape in the logarithm, when it began and when it ended."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from enum import Enum
from typing import NamedTuple

import numpy as np

from ambient_trainer.diagnosis.model import Effect, Model

_LONGEST_SHAPE, _LONGEST_EDGE_PERIODS = 0.5, 1.5
_SLOWEST_S, _FASTEST_PERIODS = 6 * 3600.0, 0.05
_SHORTEST_PERIODS = 3.0


class Kind(Enum):
    """Which number of an effect."""

    COEFFICIENT = 0
    SHAPE = 1
    ONSET = 2
    END = 3


class EffectParameter(NamedTuple):
    """One number of one of a model's effects."""

    effect: int
    kind: Kind
    term: int = 0


def unknowns(model: Model, known: bool) -> tuple[EffectParameter, ...]:
    """All that is free of a model's effects; of those that are ``known`` the coefficients, or nothing."""
    return tuple(
        each
        for index, effect in enumerate(model.effects)
        if known or not effect.known
        for each in _of(index, effect)
        if each.kind is Kind.COEFFICIENT or not effect.known
    )


def _of(index: int, effect: Effect) -> Iterator[EffectParameter]:
    candidate = effect.candidate
    for term, fixed in enumerate(candidate.fixed):
        if fixed is None:
            yield EffectParameter(index, Kind.COEFFICIENT, term)
    if candidate.reshaped is not None:
        yield EffectParameter(index, Kind.SHAPE)
    if candidate.window is None:
        if effect.onset_s is not None:
            yield EffectParameter(index, Kind.ONSET)
        if effect.end_s is not None:
            yield EffectParameter(index, Kind.END)


def small_step(unknown: EffectParameter, period_s: float) -> float:
    """A step by which differences show a slope: coefficients are linear, an edge is as sharp as a sample is long."""
    return {Kind.COEFFICIENT: 1.0, Kind.SHAPE: 0.01, Kind.ONSET: period_s, Kind.END: period_s}[unknown.kind]


def within(effect: Effect, unknown: EffectParameter, step: float, period_s: float) -> float:
    """As much of ``step`` as makes sense: within a candidate's bounds, half a shape at most, or a sample of an edge."""
    if unknown.kind is Kind.COEFFICIENT:
        low, high = effect.candidate.bounds
        value = float(effect.values[unknown.term])
        return (
            step
            if low <= value <= high and low <= value + step <= high
            else float(np.clip(value + step, low, high)) - value
        )
    if unknown.kind is Kind.SHAPE:
        size = abs(effect.candidate.shape or 1.0)
        low, high = np.log(_FASTEST_PERIODS * period_s / size), np.log(max(_SLOWEST_S / size, 1.0))
        return float(np.clip(step, max(-_LONGEST_SHAPE, min(low, 0.0)), min(_LONGEST_SHAPE, high)))
    room = _LONGEST_EDGE_PERIODS * period_s
    if effect.onset_s is not None and effect.end_s is not None:
        lasts = effect.end_s - effect.onset_s
        shorter = max(0.0, min(room, (lasts - _SHORTEST_PERIODS * period_s) / 2.0))
        return float(np.clip(step, *((-room, shorter) if unknown.kind is Kind.ONSET else (-shorter, room))))
    return float(np.clip(step, -room, room))


def moved(effect: Effect, unknown: EffectParameter, step: float) -> Effect:
    """``effect`` with one of its numbers moved by ``step``."""
    if unknown.kind is Kind.COEFFICIENT:
        values = effect.values.copy()
        values[unknown.term] += step
        return replace(effect, values=values)
    if unknown.kind is Kind.SHAPE:
        shape, reshaped = effect.candidate.shape, effect.candidate.reshaped
        if shape is None or reshaped is None:
            raise ValueError("an effect without a shape has none to move")
        return replace(effect, candidate=reshaped(shape * float(np.exp(step))))
    if unknown.kind is Kind.ONSET:
        return replace(effect, onset_s=None if effect.onset_s is None else effect.onset_s + step)
    return replace(effect, end_s=None if effect.end_s is None else effect.end_s + step)
