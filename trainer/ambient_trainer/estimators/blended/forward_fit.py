"""Fits the forward circuit to the log: capacitances, resistances, lags, shares of heat and the loss law at once.

Least squares over the sensors' misfits and over each unknown's distance from its prior, in the prior's standard
deviations, which the recipe declares.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from ambient_model.trace import REFERENCE
from ambient_trainer.circuits.assemble import assemble
from ambient_trainer.circuits.circuit import Circuit
from ambient_trainer.data.trace import Array
from ambient_trainer.estimators.blended.nonlinear_loss import Plant, simulate
from ambient_trainer.estimators.blended.recipe import Recipe
from ambient_trainer.lti.statespace import passive_modes

_PASSES = 4
_EVERY = 3
"""Neighbouring samples repeat each other: every third counts."""
_MOST_EVALUATIONS = 60


class Record(NamedTuple):
    """A stretch of the log on a uniform grid, without gaps."""

    sensors_degC: Array
    """(m, N)"""
    ambient_degC: Array
    """(N,)"""
    measured_W: Array
    shared_W: Array
    work: Array
    """The signal that separates work from idling."""

    def every(self, stride: int) -> Record:
        """Each ``stride``-th sample."""
        return Record(*(each[..., ::stride] for each in self))


@dataclass(frozen=True)
class ForwardFit:
    """The circuit as fitted to the log."""

    plant: Plant
    shares: Array
    """(n,): how much of the shared heat each node takes."""
    values: dict[str, float]
    misfit_degC: dict[str, float]
    """Per sensor the root mean square of what it misses."""
    evaluations: int
    converged: bool


class Forward:
    """A recipe's circuit as a function of its unknowns x: logarithms, shares as they are, last the logit of rho."""

    def __init__(self, recipe: Recipe, circuit: Circuit) -> None:
        self.recipe = recipe
        self.circuit = circuit
        states = [node.name for node in circuit.states]
        self.nodes = {name: index for index, name in enumerate(states)}
        self.into = self.nodes[recipe.heat.measured.into]
        self.sharing = np.array([self.nodes[name] for name in recipe.heat.shared.among])
        by_sensor = {str(node.sensor): self.nodes[node.name] for node in circuit.states}
        self.sensor_nodes = np.array([by_sensor[name] for name in recipe.sensors])
        self._fixed = {each.name: each.initial for each in circuit.parameters}
        self._free = self._free_parameters()
        loss = recipe.loss
        lags = [sensor.lag_s for sensor in recipe.sensors.values()]
        self.initial = np.concatenate(
            [
                np.log([*(self._fixed[name] for name in self._free), *lags]),
                list(recipe.heat.shared.among.values()),
                [np.log(loss.rho / (1 - loss.rho))],
            ]
        )
        prior = recipe.prior
        self.deviation = np.array(
            [
                *self._free.values(),
                *[prior.lag] * len(lags),
                *[prior.share] * len(self.sharing),
                prior.rho,
            ]
        )

    def _free_parameters(self) -> dict[str, float]:
        """Per free capacitance and resistance the prior standard deviation of its logarithm."""
        prior = self.recipe.prior
        deviation = {str(node.capacitance): prior.capacitance for node in self.circuit.states}
        deviation.update({edge.resistance: prior.resistance for edge in self.circuit.edges})
        free = {each.name for each in self.circuit.parameters if each.free}
        return {name: each for name, each in deviation.items() if name in free}

    def values(self, x: Array) -> dict[str, float]:
        """The unknowns by name, in their own units."""
        lags = [f"lag_{name}" for name in self.recipe.sensors]
        positive = np.exp(x[: len(self._free) + len(lags)])
        shares = x[len(positive) : -1]
        return {
            **dict(zip([*self._free, *lags], positive.tolist())),
            **dict(zip([f"share_{name}" for name in self.recipe.heat.shared.among], shares.tolist())),
            "rho": float(1 / (1 + np.exp(-x[-1]))),
        }

    def plant(self, x: Array) -> Plant:
        """The circuit at ``x``."""
        free = len(self._free)
        assembled = assemble(self.circuit, {**self._fixed, **dict(zip(self._free, np.exp(x[:free])))})
        column = self.circuit.inputs.index(REFERENCE)
        return Plant(
            *passive_modes(assembled.value.A, assembled.capacitance),
            capacitance=assembled.capacitance,
            to_ambient=assembled.value.B[:, column] * assembled.capacitance,
            rho=float(1 / (1 + np.exp(-x[-1]))),
            sensor_nodes=self.sensor_nodes,
            lags_s=np.exp(x[free : free + len(self.sensor_nodes)]),
        )

    def shares(self, x: Array) -> Array:
        """How much of the shared heat each node takes, (n,)."""
        found = np.zeros(len(self.nodes))
        found[self.sharing] = x[-1 - len(self.sharing) : -1]
        return found

    def heat_W(self, shares: Array, measured_W: Array, shared_W: Array) -> Array:
        """The logged heat into each node, (n, N)."""
        heat = np.outer(shares, shared_W)
        heat[self.into] += measured_W
        return heat

    def misfits(self, x: Array, records: Sequence[Record], period_s: float) -> list[Array]:
        """Per record the sensors minus the simulated ones, (m, N)."""
        plant, shares = self.plant(x), self.shares(x)
        return [
            each.sensors_degC
            - simulate(
                plant,
                self.recipe.loss,
                each.ambient_degC,
                self.heat_W(shares, each.measured_W, each.shared_W),
                period_s,
                _PASSES,
            )
            for each in records
        ]


def fit_forward(
    forward: Forward, records: Sequence[Record], period_s: float, show: Callable[[int, float], None]
) -> ForwardFit:
    """Fit the circuit to ``records``; ``show`` is called with the evaluations and the sum of squares."""
    recipe = forward.recipe
    trust = np.array([sensor.trust_degC for sensor in recipe.sensors.values()])[:, None]
    kept = sum(len(each.ambient_degC[::_EVERY]) for each in records)
    weight = np.sqrt(recipe.prior.samples / kept) / trust
    evaluations = 0

    def residuals(x: Array) -> Array:
        nonlocal evaluations
        evaluations += 1
        found = [(each[:, ::_EVERY] * weight).ravel() for each in forward.misfits(x, records, period_s)]
        rows = np.concatenate([*found, (x - forward.initial) / forward.deviation])
        show(evaluations, float(rows @ rows))
        return rows

    result = least_squares(residuals, forward.initial, max_nfev=_MOST_EVALUATIONS, x_scale=forward.deviation)
    misfit = np.concatenate(forward.misfits(result.x, records, period_s), axis=1)
    return ForwardFit(
        plant=forward.plant(result.x),
        shares=forward.shares(result.x),
        values=forward.values(result.x),
        misfit_degC=dict(zip(recipe.sensors, np.sqrt(np.mean(misfit**2, axis=1)).tolist())),
        evaluations=evaluations,
        converged=bool(result.status > 0),
    )
