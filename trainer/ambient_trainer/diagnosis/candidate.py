"""A candidate is a cause at a place, with the terms that it adds and how its coefficients are read."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from ambient_trainer.circuits.circuit import Circuit
from ambient_trainer.diagnosis.plant import Plant
from ambient_trainer.diagnosis.result import Cause, Magnitude
from ambient_trainer.diagnosis.terms import Law, Term, into
from ambient_trainer.diagnosis.view import View

Array = NDArray[np.float64]


class Span(Enum):
    """When it may act: all the time, from some moment on, or between two."""

    WHOLE = 0
    ONSET = 1
    WINDOW = 2


@dataclass(frozen=True)
class Estimate:
    """Coefficients (k,) and their covariance, fitted to records of which ``view`` is the longest.

    ``covariance`` (k + 1, k + 1) holds that of the shape's logarithm behind, zero where there is none.
    """

    view: View
    values: Array
    covariance: Array

    def deviation(self, index: int) -> float:
        """The standard error of one coefficient, or behind them of the shape's logarithm."""
        return float(np.sqrt(max(self.covariance[index, index], 0.0)))

    def interval(self, index: int, scale: float = 1.0) -> tuple[float, float]:
        """The 95 % interval of one coefficient times ``scale``."""
        half = 1.96 * self.deviation(index)
        ends = sorted((scale * (self.values[index] - half), scale * (self.values[index] + half)))
        return float(ends[0]), float(ends[1])


Parameters = dict[str, tuple[float, str]]


@dataclass(frozen=True)
class Candidate:
    """A cause with k terms, each linear in its coefficient.

    ``fixed`` holds coefficients that the cause knows (None: free); ``plausible`` tells which coefficients (..., k)
    physics allows; ``inner`` counts unknowns that are not coefficients; ``reshaped`` makes the same candidate with
    another value of the one inner unknown, which now is ``shape``. ``extend`` adds it, at its coefficients (k,), to a
    circuit; None where no circuit can hold it.
    """

    cause: Cause
    span: Span
    terms: Callable[[View], tuple[Term, ...]]
    magnitude: Callable[[Estimate], Magnitude]
    parameters: Callable[[Estimate], Parameters] = field(default=lambda found: {})
    fixed: tuple[float | None, ...] = (None,)
    plausible: Callable[[Array], NDArray[np.bool_]] = field(default=lambda values: np.isfinite(values).all(axis=-1))
    bounds: tuple[float, float] = (-np.inf, np.inf)
    """Between which a coefficient is looked for."""
    start: Callable[[Array], Array] = field(default=lambda values: values)
    """Where to start simulating from, given what a regression found, (k,)."""
    shape: float | None = None
    reshaped: Callable[[float], Candidate] | None = None
    extend: Callable[[Circuit, Array], Circuit] | None = None
    window: tuple[float | None, float | None] | None = None
    """When it acts, where that is known beforehand: None is a record's own end."""
    faulty: frozenset[int] = frozenset()
    """The sensors that are not to be trusted_sensors if this is the cause."""

    @property
    def free(self) -> int:
        """How many coefficients are fitted."""
        return sum(each is None for each in self.fixed)


@dataclass(frozen=True)
class Setting:
    """What candidates are made for: the plant, the signals that vary, and whether a power sets the scale of heat."""

    plant: Plant
    signals: tuple[str, ...]
    heat_in_W: bool
    loss: Callable[[Plant], Law]
    """What each node of a plant gives off to the ambient, (n, ...) in W, as far as is known."""
    flat: tuple[tuple[float | None, float | None] | None, ...]
    """Per sensor from when until when it read the same while it should have moved; None where it never did."""
    circuit_is_free: bool = False
    """Whether the circuit's own parameters are fitted along with a candidate, as freely as it is."""

    def heat_unit(self, node: int) -> tuple[float, str]:
        """What a heat in W into ``node`` is multiplied with to be told, and the unit then."""
        return (1.0, "W") if self.heat_in_W else (1.0 / float(self.plant.capacitance[node]), "K/s")

    @property
    def conductance_unit(self) -> str:
        """The unit of a conductance in W/K times what :meth:`heat_unit` says."""
        return "W/K" if self.heat_in_W else "1/s"

    def into(self, node: int, law: Law) -> Law:
        """The law of the heat into one node."""
        return into(node, len(self.plant.nodes), law)

    def node(self, sensor: int) -> int:
        """The state that a sensor reads."""
        return int(self.plant.reads[sensor])
