"""``circuit_observer``: the steady-state Kalman filter of a circuit under a random-walk ambient.

Circuit, process and measurement noise minimise its error of the reference (prediction-error form). The likelihood of
the sensors' own innovations does not determine the ambient's scale: a wider walk behind longer time constants gives the
same sensors.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ambient_model.faults import refuse
from ambient_trainer.data.trace import Array
from ambient_trainer.estimation.search import Progress, search
from ambient_trainer.estimators.base import Effort, Estimator, Fit
from ambient_trainer.estimators.kalman.observer_structure import ObserverStructure, prior_theta, walk_of
from ambient_trainer.estimators.kalman.random_walk import RandomWalkAmbient
from ambient_trainer.estimators.observer import late, rescored, with_fallbacks_and_variance
from ambient_trainer.estimators.searched import MODES, fit_of
from ambient_trainer.estimators.training import Training, require_enough
from ambient_trainer.lti.reduce import reduced

NAMES = ("circuit_observer",)
_MOST_SENSORS = 8
_MOST_STATES = 4
_MOST_STARTS = 3
"""Held near the prior, all starts end at one place; three show that they do."""


def find(name: str) -> CircuitObserver | None:
    """The estimator called ``name``, or None."""
    return CircuitObserver() if name in NAMES else None


class CircuitObserver(Estimator):
    """Fits the observer, and one without each of its inputs."""

    name = NAMES[0]

    def fit_to(self, training: Training, effort: Effort, progress: Progress | None) -> Fit:
        """The fit to grids of these columns; at most three of ``effort.starts`` are made.

        Raises :class:`Refused` for more sensors than a trace determines.
        """
        columns, segments, traces = training
        if len(columns) > _MOST_SENSORS:
            problem = f"{len(columns)} temperatures make a circuit with more unknowns than a trace determines"
            raise refuse(self.name, "", problem, f"name the best {_MOST_SENSORS} or fewer with --sensors")
        walk = walk_of(segments)
        circuit = RandomWalkAmbient(columns, walk)
        structure = ObserverStructure(circuit, prior_theta(circuit, segments), segments)
        require_enough(traces, structure)
        main = _fitted(columns, structure, replace(effort, starts=min(effort.starts, _MOST_STARTS)), progress)

        def fallback(dropped: int) -> Fit:
            left, parts, _ = training.without(dropped)
            smaller = RandomWalkAmbient(left, walk)
            start = struck_out(circuit, smaller, np.log([each.value for each in main.parameters]), dropped)
            structure = ObserverStructure(smaller, start, parts)
            return _fitted(left, structure, replace(effort, starts=1, pieces=1), late(progress, effort))

        states = len(columns) + 1
        remark = f"The circuit has {states} states: a node a sensor, and the ambient"
        remark += f"; balanced down to {len(main.states)}." if states > len(main.states) else "."
        return with_fallbacks_and_variance(main, segments, (), fallback, remark, {"states_of_circuit": states})


def _fitted(columns: Sequence[str], structure: ObserverStructure, effort: Effort, progress: Progress | None) -> Fit:
    result = search(structure, effort.starts, effort.seed, progress, effort.budget)
    theta, circuit = result.best.theta, structure.circuit
    whole = circuit.filter(theta)
    whole.offset[:] = result.best.beta
    system = reduced(whole, _MOST_STATES)
    unknowns = [(name, unit, value, True) for (name, unit), value in zip(circuit.units.items(), np.exp(theta).tolist())]
    names = (NAMES[0], columns, MODES[: len(system.A)])
    return rescored(fit_of(structure, result, effort, system, unknowns, *names), structure.segments)


def struck_out(whole: RandomWalkAmbient, smaller: RandomWalkAmbient, theta: Array, dropped: int) -> Array:
    """The theta of the circuit that lacks a node, its capacities in terms of its own first one."""
    known = dict(zip(whole.names, theta.tolist()))
    first = known[whole.names[whole.count]] if dropped == 0 else 0.0
    shift = {"C": first, "g": first}
    return np.array([known[name] - shift.get(name.partition("_")[0], 0.0) for name in smaller.names])
