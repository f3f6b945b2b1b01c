"""What the faults of a sensor share: one sensor, its terms, and that its readings are not trusted."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ambient_trainer.diagnosis.candidate import Candidate, Estimate, Span
from ambient_trainer.diagnosis.result import Cause, Magnitude
from ambient_trainer.diagnosis.terms import DriftTerm, SensorTerm, Term
from ambient_trainer.diagnosis.view import View

Array = NDArray[np.float64]


def reads(sensor: int, *laws: Callable[[Array], Array]) -> Callable[[View], tuple[Term, ...]]:
    """Terms by which the sensor's reading is off, each a law of what it should read."""
    return lambda view: tuple(SensorTerm(sensor, law) for law in laws)


def drifts(sensor: int) -> Callable[[View], tuple[Term, ...]]:
    """The term of an error that grows with time."""
    return lambda view: (DriftTerm(sensor),)


def faulty(
    cause: str,
    sensor: int,
    name: str,
    span: Span,
    terms: Callable[[View], tuple[Term, ...]],
    magnitude: Callable[[Estimate], Magnitude],
    fixed: tuple[float | None, ...] = (None,),
) -> Candidate:
    """A candidate by which one sensor is not trusted."""
    return Candidate(Cause(cause, name), span, terms, magnitude, fixed=fixed, faulty=frozenset((sensor,)))
