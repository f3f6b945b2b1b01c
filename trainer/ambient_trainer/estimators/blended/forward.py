"""The forward circuit of a recipe: what its sensors read for an ambient and heat, and its fit to the log.

A surface at T in air at T_a gives off, with dT = T - T_a,

    q = G dT f,   f = (1 - rho) ((dT^2 + 0.25 K^2) / rise^2)^(exponent / 2) + rho (T_mean / T_ref)^3

with T_mean = (T + T_a) / 2 in kelvin: natural convection and linearised radiation, each 1 at ``at_rise_K`` and
``at_degC`` (Incropera and DeWitt, chapters 1 and 9). The linear circuit is solved exactly in its modes under a
first-order hold; what the loss differs from G dT, as heat into the surface, is found by iterating: some four passes.

Capacitances, resistances, lags, shares of heat and rho are fitted at once: least squares over the sensors' misfits and
over each unknown's distance from its prior, in the prior's standard deviations, which the recipe declares.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from ambient_model.trace import REFERENCE
from ambient_trainer.circuits import Circuit, assemble
from ambient_trainer.data.trace import Array
from ambient_trainer.estimators.blended.recipe import Loss, Recipe
from ambient_trainer.lti import lagged, passive_modes

_LEAST_RISE_K2 = 0.25
"""Keeps the law smooth where the rise changes its sign."""
_KELVIN = 273.15
_PASSES = 4
_EVERY = 3
"""Neighbouring samples repeat each other: every third counts."""
_MOST_EVALUATIONS = 60


class PlantRecord(NamedTuple):
    """A stretch of the log on a uniform grid, without gaps: sensors (m, N), the others (N,).

    ``work`` is the signal that separates work from idling.
    """

    sensors_degC: Array
    ambient_degC: Array
    measured_W: Array
    shared_W: Array
    work: Array

    def every(self, stride: int) -> PlantRecord:
        """Each ``stride``-th sample."""
        return PlantRecord(*(each[..., ::stride] for each in self))


class Plant:
    """A recipe's circuit at ``values`` in its modes, with n states, m sensors on some of them, and heat into each."""

    def __init__(self, recipe: Recipe, circuit: Circuit, values: Mapping[str, float]) -> None:
        names = [node.name for node in circuit.states]
        assembled = assemble(circuit, {each.name: values.get(each.name, each.initial) for each in circuit.parameters})
        self.nodes = {name: index for index, name in enumerate(names)}
        self.capacitance = assembled.capacitance
        # rates (n,) < 0 in 1/s; right (n, n) makes node temperatures of modes, left the modes of them
        self.rates, self.right, self.left = passive_modes(assembled.value.A, self.capacitance)
        self.to_ambient_W_K = assembled.value.B[:, circuit.inputs.index(REFERENCE)] * self.capacitance
        self.loss, self.rho = recipe.loss, values["rho"]
        by_sensor = {str(node.sensor): index for index, node in enumerate(circuit.states)}
        self.sensors = [(by_sensor[name], values[f"lag_{name}"]) for name in recipe.sensors]
        self.measured = np.array([float(name == recipe.heat.measured.into) for name in names])
        self.shares = np.array([values.get(f"share_{name}", 0.0) for name in names])

    def heat_W(self, measured_W: Array, shared_W: Array) -> Array:
        """The logged heat into each node, (n, N)."""
        return np.outer(self.shares, shared_W) + np.outer(self.measured, measured_W)

    def readings_degC(self, ambient_degC: Array, heat_W: Array, period_s: float, passes: int) -> Array:
        """What the sensors read, (m, N), for the ambient (N,) and the heat into the nodes (n, N), from equilibrium."""
        surfaces = np.flatnonzero(self.to_ambient_W_K)
        extra = np.zeros_like(heat_W)
        for index in range(passes):
            heat = self.to_ambient_W_K[:, None] * ambient_degC + (heat_W + extra)
            drive = self.left @ (heat / self.capacitance[:, None])
            modes = [lagged(row / -rate, -1 / rate, period_s) for row, rate in zip(drive, self.rates.tolist())]
            nodes = self.right @ np.array(modes)
            if index < passes - 1:
                rise = nodes[surfaces] - ambient_degC
                bent = factor(rise, (nodes[surfaces] + ambient_degC) / 2, self.rho, self.loss)
                extra[surfaces] = -self.to_ambient_W_K[surfaces, None] * rise * (bent - 1)
        return np.vstack([lagged(nodes[n], lag, period_s) for n, lag in self.sensors])

    def misfits(self, records: Sequence[PlantRecord], period_s: float, passes: int = _PASSES) -> list[Array]:
        """Per record the sensors minus the simulated ones, (m, N)."""
        heats = [self.heat_W(each.measured_W, each.shared_W) for each in records]
        simulated = (self.readings_degC(r.ambient_degC, W, period_s, passes) for r, W in zip(records, heats))
        return [each.sensors_degC - readings for each, readings in zip(records, simulated)]


def factor(rise_K: Array, mean_degC: Array, rho: float, loss: Loss) -> Array:
    """f: the loss as a multiple of G dT."""
    convection = ((rise_K**2 + _LEAST_RISE_K2) / loss.at_rise_K**2) ** (loss.exponent / 2)
    radiation = ((mean_degC + _KELVIN) / (loss.at_degC + _KELVIN)) ** 3
    return np.asarray((1 - rho) * convection + rho * radiation)


class ForwardFit(NamedTuple):
    """The circuit as fitted to the log; ``misfit_degC`` is per sensor the root mean square of what it misses."""

    plant: Plant
    values: dict[str, float]
    misfit_degC: dict[str, float]
    evaluations: int
    converged: bool


class Forward:
    """A recipe's circuit as a function of its unknowns x: logarithms, shares as they are, last the logit of rho."""

    def __init__(self, recipe: Recipe, circuit: Circuit) -> None:
        self.recipe, self.circuit = recipe, circuit
        prior, rho = recipe.prior, recipe.loss.rho
        kinds = {str(node.capacitance): prior.capacitance for node in circuit.states}
        kinds |= {edge.resistance: prior.resistance for edge in circuit.edges}
        free = {each.name: each.initial for each in circuit.parameters if each.free}
        positive = [(name, free[name], kind) for name, kind in kinds.items() if name in free]
        positive += [(f"lag_{name}", sensor.lag_s, prior.lag) for name, sensor in recipe.sensors.items()]
        shares = [(f"share_{name}", share, prior.share) for name, share in recipe.heat.shared.among.items()]
        self._names, first, deviation = zip(*positive, *shares, ("rho", np.log(rho / (1 - rho)), prior.rho))
        self._positive = len(positive)
        self.initial, self.deviation = np.array(first), np.array(deviation)
        self.initial[: self._positive] = np.log(self.initial[: self._positive])

    def values(self, x: Array) -> dict[str, float]:
        """The unknowns by name, in their own units."""
        linear, rho = x[self._positive : -1].tolist(), float(1 / (1 + np.exp(-x[-1])))
        return dict(zip(self._names, [*np.exp(x[: self._positive]).tolist(), *linear, rho]))

    def plant(self, x: Array) -> Plant:
        """The circuit at ``x``."""
        return Plant(self.recipe, self.circuit, self.values(x))

    def fit(self, records: Sequence[PlantRecord], period_s: float, show: Callable[[int, float], None]) -> ForwardFit:
        """Fit the circuit to ``records``; ``show`` is called with the evaluations and the sum of squares."""
        trust = np.array([sensor.trust_degC for sensor in self.recipe.sensors.values()])[:, None]
        kept = sum(len(each.ambient_degC[::_EVERY]) for each in records)
        weight = np.sqrt(self.recipe.prior.samples / kept) / trust
        evaluations = 0

        def residuals(x: Array) -> Array:
            nonlocal evaluations
            evaluations += 1
            found = [(each[:, ::_EVERY] * weight).ravel() for each in self.plant(x).misfits(records, period_s)]
            rows = np.concatenate([*found, (x - self.initial) / self.deviation])
            show(evaluations, float(rows @ rows))
            return rows

        result = least_squares(residuals, self.initial, max_nfev=_MOST_EVALUATIONS, x_scale=self.deviation)
        plant = self.plant(result.x)
        misfit = np.sqrt(np.mean(np.concatenate(plant.misfits(records, period_s), axis=1) ** 2, axis=1)).tolist()
        by_sensor = dict(zip(self.recipe.sensors, misfit))
        return ForwardFit(plant, self.values(result.x), by_sensor, evaluations, bool(result.status > 0))
