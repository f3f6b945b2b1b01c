"""Many plans on one model at once, each from its own rest.

Between two switches a device with effects is x' = f(x) with nothing from outside changing, so a step is exponential:

    x[k+1] = x[k] + h phi1(h J) f(x[k]) + h phi2(h J) (g(a) - g(x[k])),    g(x) = f(x) - J x,

J being f's Jacobian after the switch and a the step without its last part. It is exact for all that is linear, however
fast, and of second order for the rest (Hochbruck and Ostermann 2010).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from ambient_trainer.diagnosis.model import Effect, Model
from ambient_trainer.diagnosis.plant import Plant
from ambient_trainer.diagnosis.record import Record
from ambient_trainer.diagnosis.terms import HeatTerm, SensorTerm, Term
from ambient_trainer.diagnosis.view import View

Array = NDArray[np.float64]

_MOST_ROUNDS = 30
_SMALL_K = 1e-3
_AT_REST_K = 1e-6
_FASTEST_PER_S = 1e6
_CURVED_K = 7.0
"""Two points so far apart show whether heat is linear in temperature."""


@dataclass(frozen=True)
class Course:
    """One plan carried out: each column (N,) by name, and 1 where the effect is made to act, (N,); None leaves it."""

    columns: Mapping[str, Array]
    happens: Array | None


@dataclass(frozen=True)
class Predicted:
    """What the sensors read in E plans, (E, s, N), and what of that is their own error."""

    readings_degC: Array
    errors_degC: Array


def predicted(
    model: Model, repeated: Effect | None, courses: Sequence[Course], time_s: Array, since_s: float
) -> Predicted:
    """The readings of ``model`` in each course, on the even ``time_s`` (N,) of the device's own clock.

    Effects that lasted to the end of the records go on, those that ended stay over; ``repeated`` acts where a course
    says so. ``since_s`` is when the records began.
    """
    plant = replace(model.plant, period_s=float(time_s[1] - time_s[0]))
    views = [_bare(plant, course, time_s) for course in courses]
    parts = [part for effect in model.effects for part in _parts(effect, effect is repeated, courses, views)]
    inputs = np.array([view.record.inputs for view in views])
    air = np.array([view.ambient_degC for view in views])
    heats = [_Heat(part.weight, part.term) for part in parts if isinstance(part.term, HeatTerm)]
    with np.errstate(over="ignore", invalid="ignore"):
        truth = _Device(plant, np.einsum("nm,emk->nek", plant.B, inputs), air, heats).run()[plant.reads]
        errors = np.zeros_like(truth)
        for term, weight, onset_s in parts:
            if isinstance(term, SensorTerm):
                errors[term.sensor] += weight * term.law(truth[term.sensor])
            elif not isinstance(term, HeatTerm):
                began_s = since_s if onset_s is None else onset_s
                errors[term.sensor] += weight * np.maximum(0.0, time_s - began_s)
    return Predicted(np.swapaxes(truth + errors, 0, 1), np.swapaxes(errors, 0, 1))


def _bare(plant: Plant, course: Course, time_s: Array) -> View:
    """The signals and inputs of a course, which is all that terms depend on."""
    inputs = np.array([course.columns[name] for name in plant.circuit.inputs])
    unread = np.full((len(plant.reads), len(time_s)), np.nan)
    return View.bare(plant, Record(plant.period_s, time_s, inputs, unread, course.columns))


class _Part(NamedTuple):
    """One term of an effect, its coefficient times all that weighs it, (E, N), and the effect's onset."""

    term: Term
    weight: Array
    onset_s: float | None


def _parts(effect: Effect, repeated: bool, courses: Sequence[Course], views: Sequence[View]) -> Iterator[_Part]:
    going_on = np.full(views[0].record.samples, float(effect.end_s is None))
    acting = np.array([going_on if not repeated or each.happens is None else each.happens for each in courses])
    for value, terms in zip(effect.values, zip(*(effect.candidate.terms(view) for view in views))):
        weights = [term.weight if isinstance(term, HeatTerm) else np.ones_like(going_on) for term in terms]
        yield _Part(terms[0], float(value) * (acting * np.array(weights)), effect.onset_s)


class _Heat(NamedTuple):
    """``weight`` (E, N) times the term's law, less its lag where it has one."""

    weight: Array
    term: HeatTerm


@dataclass(frozen=True)
class _Device:
    """A plant with effects in E courses: ``drive`` (n, E, N) is B u.

    Its state y (d, E) holds the nodes, then the lag of every heat that has one.
    """

    plant: Plant
    drive: Array
    air: Array
    heats: Sequence[_Heat]

    def run(self) -> Array:
        """The nodes from equilibrium, (n, E, N)."""
        y = self._equilibrium()
        switched = self._switched()
        curved = not np.allclose(self._jacobian(y, 0), self._jacobian(y + _CURVED_K, 0), rtol=1e-6, atol=1e-12)
        result = np.empty_like(self.drive)
        result[:, :, 0] = y[: len(self.drive)]
        for k in range(self.drive.shape[2] - 1):
            if switched[k]:
                J = self._jacobian(y, k)
                phi1, phi2 = _phi(J, self.plant.period_s)
            slope = self._slope(y, k)
            moved = y + _times(phi1, slope)
            if curved:
                moved = moved + _times(phi2, self._slope(moved, k) - slope - _times(J, moved - y))
            y = moved
            result[:, :, k + 1] = y[: len(self.drive)]
        return result

    def _slope(self, y: Array, k: int) -> Array:
        """y' in every course, (d, E)."""
        n = len(self.drive)
        nodes, place = y[:n], n
        heat = np.zeros_like(nodes)
        lags = []
        for weight, term in self.heats:
            value = term.law(nodes, self.air[:, k])
            if term.lag_s is not None:
                value = value - y[place : place + n]
                lags.append(value / term.lag_s)
                place += n
            heat += weight[:, k] * value
        slope = self.plant.A @ nodes + self.drive[:, :, k] + heat / self.plant.capacitance[:, None]
        return np.concatenate([slope, *lags])

    def _jacobian(self, y: Array, k: int) -> Array:
        """The slope's, in every course, (E, d, d)."""
        steps = _SMALL_K * np.eye(len(y))[:, :, None]
        columns = [(self._slope(y + step, k) - self._slope(y - step, k)) / (2 * _SMALL_K) for step in steps]
        # where a course has run away, its slope shows it: the Jacobian only has to stay finite
        finite = np.nan_to_num(np.array(columns), nan=0.0, posinf=0.0, neginf=0.0)
        return np.moveaxis(np.clip(finite, -_FASTEST_PER_S, _FASTEST_PER_S), (0, 1, 2), (2, 1, 0))

    def _equilibrium(self) -> Array:
        """The state in which nothing moves, by Newton's method, (d, E); NaN where there is none."""
        lags = sum(each.term.lag_s is not None for each in self.heats)
        y = np.tile(self.air[:, 0], (len(self.drive) * (1 + lags), 1))
        for _ in range(_MOST_ROUNDS):
            # a part that nothing joins to the others stays where it is
            step = _times(np.linalg.pinv(self._jacobian(y, 0)), self._slope(y, 0))
            y = y - step
            if not np.abs(step).max() > 1e-9:
                break
        return np.where(np.abs(step).max(axis=0) < _AT_REST_K, y, np.nan)

    def _switched(self) -> NDArray[np.bool_]:
        """Whether anything outside differs from a sample before, (N,)."""
        rows = np.concatenate([self.drive.reshape(-1, self.drive.shape[2]), *(each.weight for each in self.heats)])
        return np.concatenate([[True], (np.diff(rows, axis=1) != 0).any(axis=0)])


def _times(matrices: NDArray[np.floating], y: Array) -> Array:
    """(E, d, d) on (d, E)."""
    return np.asarray((matrices @ y.T[:, :, None])[:, :, 0].T)


def _phi(J: Array, step_s: float) -> tuple[Array, Array]:
    """h phi1(h J) and h phi2(h J), (E, d, d) each, from one exponential."""
    d = J.shape[1]
    block = np.zeros((len(J), 3 * d, 3 * d))
    block[:, :d, :d] = step_s * J
    block[:, :d, d : 2 * d] = block[:, d : 2 * d, 2 * d :] = np.eye(d)
    whole = expm(block)
    return step_s * whole[:, :d, d : 2 * d], step_s * whole[:, :d, 2 * d :]
