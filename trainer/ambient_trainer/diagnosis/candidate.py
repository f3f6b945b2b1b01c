"""What a module of a cause is made of: its kind, and its candidates, each at one place with the terms that it adds."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from ambient_trainer.circuits.circuit import Circuit
from ambient_trainer.diagnosis.plant import Plant
from ambient_trainer.diagnosis.result import Cause, Magnitude
from ambient_trainer.diagnosis.terms import HeatTerm, Law, Term, into
from ambient_trainer.diagnosis.view import View, conductances_to_ambient
from ambient_trainer.diagnosis.words import unit_of

Array = NDArray[np.float64]
Parameters = dict[str, tuple[float, str]]

DELTA_95 = 1.96
"""Half a 95 % interval, in standard deviations of a normal distribution."""


class Span(Enum):
    """When a candidate may act: all the time, from an onset on, or between an onset and an end."""

    WHOLE = 0
    ONSET = 1
    WINDOW = 2


@dataclass(frozen=True)
class Estimate:
    """Coefficients (k,) and their covariance, fitted to records of which ``view`` is the longest.

    The last row and column of ``covariance`` (k + 1, k + 1) are those of the shape's logarithm, zero without a shape.
    """

    view: View
    values: Array
    covariance: Array

    def deviation(self, index: int) -> float:
        """The standard error of one coefficient, or, behind them, of the shape's logarithm."""
        return float(np.sqrt(max(self.covariance[index, index], 0.0)))

    def interval(self, index: int, scale: float = 1.0) -> tuple[float, float]:
        """The 95 % interval of one coefficient times ``scale``."""
        half = DELTA_95 * self.deviation(index)
        low, high = sorted((scale * (self.values[index] - half), scale * (self.values[index] + half)))
        return float(low), float(high)

    def half_width(self, slope: Array) -> float:
        """Half the 95 % interval of a function of the numbers with this ``slope`` (delta method)."""
        covariance = self.covariance[: len(slope), : len(slope)]
        return DELTA_95 * float(np.sqrt(max(float(slope @ covariance @ slope), 0.0)))


@dataclass(frozen=True)
class Candidate:
    """A cause at a place, with k terms, each linear in its coefficient.

    ``fixed`` holds known coefficients (None: free), ``plausible`` says which coefficients (..., k) physics allows.
    ``shape`` is the one number in which the terms are not linear, ``reshaped`` the same candidate with another.
    ``extend`` adds it, at its coefficients (k,), to a circuit; None where no circuit can hold it.
    """

    cause: Cause
    span: Span
    terms: Callable[[View], tuple[Term, ...]]
    magnitude: Callable[[Estimate], Magnitude]
    parameters: Callable[[Estimate], Parameters] = field(default=lambda estimate: {})
    fixed: tuple[float | None, ...] = (None,)
    plausible: Callable[[Array], NDArray[np.bool_]] = field(default=lambda values: np.isfinite(values).all(axis=-1))
    bounds: tuple[float, float] = (-np.inf, np.inf)
    """Of each coefficient."""
    start: Callable[[Array], Array] = field(default=lambda values: values)
    """Coefficients to start simulating from, given those of a regression, (k,)."""
    shape: float | None = None
    reshaped: Callable[[float], Candidate] | None = None
    extend: Callable[[Circuit, Array], Circuit] | None = None
    window: tuple[float | None, float | None] | None = None
    """When it acts, where that is known beforehand: None is a record's own end."""
    faulty: frozenset[int] = frozenset()
    """The sensors whose readings are not trusted if this is the cause."""

    @property
    def free(self) -> int:
        """The number of fitted coefficients."""
        return sum(each is None for each in self.fixed)


@dataclass(frozen=True)
class Setting:
    """What candidates are made for: the plant, the signals that vary, and whether a power sets the scale of heat."""

    plant: Plant
    signals: tuple[str, ...]
    heat_in_W: bool
    loss: Callable[[Plant], Law]
    """What each node of a plant gives off to the ambient, (n, ...) in W."""
    flat: tuple[tuple[float | None, float | None] | None, ...]
    """Per sensor from when until when it read the same while its simulation moved; None where it never did."""
    circuit_is_free: bool = False
    """Whether the circuit's own parameters are fitted along with a candidate, as freely as it is."""

    def heat_unit(self, node: int) -> tuple[float, str]:
        """The factor from W into ``node`` to the unit of its heat, and that unit."""
        return (1.0, "W") if self.heat_in_W else (1.0 / float(self.plant.capacitance[node]), "K/s")

    @property
    def conductance_unit(self) -> str:
        """The unit of a conductance in W/K times the factor of :meth:`heat_unit`."""
        return "W/K" if self.heat_in_W else "1/s"

    def into(self, node: int, law: Law) -> Law:
        """The law of the heat into one node, ``law`` being one number at each time."""
        return into(node, len(self.plant.nodes), law)

    @property
    def to_ambient(self) -> list[int | None]:
        """The nodes joined to the ambient, and None for all of them alike where there are several."""
        joined = np.flatnonzero(conductances_to_ambient(self.plant)).tolist()
        return [None, *joined] if len(joined) > 1 else [None] if joined else []

    def named(self, node: int | None) -> str:
        """A node's name, or ``all nodes``."""
        return "all nodes" if node is None else self.plant.nodes[node]

    def working_sensors(self) -> Iterator[tuple[int, str]]:
        """Index and name of each sensor that never stood still; one that did is stuck."""
        return ((index, name) for index, name in enumerate(self.plant.sensors) if self.flat[index] is None)


@dataclass(frozen=True)
class CauseKind:
    """One cause of the contract, as its module in ``diagnosis/causes`` defines it by the name ``KIND``.

    Parameters
    ----------
    name : str
        The cause, as ``diagnose --json`` prints it.
    noun : str
        The cause as a noun, for verdicts: ``a sensor that drifts``.
    claim : str
        What it says of the device, as a clause; ``{place}`` stands where the location does.
    candidates : callable
        From a :class:`Setting` to the candidates of this cause, one a place and driver.
    not_in_circuit : callable
        From a :class:`Cause` to the reason why a circuit cannot hold it; used where a candidate has no ``extend``.
    rank : int
        Order of the causes, the simplest first.
    built_in : bool
        Whether a device without a fault may have it, so that the circuit may need it to describe known-good records.
    heats : bool
        Whether it is heat that a warmer ambient would look like.
    one_sign : bool
        Whether the opposite sign counts as one more degree of freedom: heat may be removed, but takes a machine.
    bends_loss : bool
        Whether it changes the law of the loss, for other candidates too, where known-good records show it.
    shifts_clock : bool
        Whether its shape, in s, is by how much a record's reference is early or late.
    """

    name: str
    noun: str
    claim: str
    candidates: Callable[[Setting], Iterator[Candidate]]
    not_in_circuit: Callable[[Cause], str] = field(default=lambda cause: INSTRUMENT)
    rank: int = 100
    built_in: bool = False
    heats: bool = False
    one_sign: bool = False
    bends_loss: bool = False
    shifts_clock: bool = False


INSTRUMENT = "it is the instrument, not the heat: repair it, or correct the column in the trace"


def heat(law: Law) -> Callable[[View], tuple[Term, ...]]:
    """The terms of a heat by ``law`` that depends on no signal."""
    return lambda view: (HeatTerm(view.ones, law),)


def constant(nodes_degC: Array, ambient_degC: Array) -> Array:
    """The law of a heat that does not depend on any temperature."""
    return np.ones_like(ambient_degC)


def first_coefficient(unit: str, meaning: str, scale: float = 1.0) -> Callable[[Estimate], Magnitude]:
    """Reads the first coefficient, times ``scale``, as the magnitude."""

    def read(estimate: Estimate) -> Magnitude:
        return Magnitude(scale * float(estimate.values[0]), unit, meaning, estimate.interval(0, scale))

    return read


def positive(values: Array) -> NDArray[np.bool_]:
    """Whether every coefficient is above zero, (...)."""
    return np.asarray((values > 0).all(axis=-1))


def per(unit: str, signal: str) -> str:
    """``unit`` per unit of a trace column: on/off signals and fractions have none."""
    return f"{unit} per {unit_of(signal)}" if unit_of(signal) else unit
