"""``circuit_observer``: the filter of a circuit whose ambient walks, taught by its error of the ambient.

Process and measurement noise are those that make the smallest error of the reference (prediction-error form). The
likelihood of the sensors' own innovations is no substitute: it knows the ambient's scale from nowhere, as a wider walk
behind longer time constants gives the same sensors.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from ambient_model.faults import refuse
from ambient_trainer.data.trace import Trace
from ambient_trainer.estimation.search import Progress
from ambient_trainer.estimators.fit import (
    Effort,
    Fit,
    estimated,
    estimator_data,
    fit_of,
    require_enough,
    searched,
)
from ambient_trainer.estimators.kalman.assemble import Member, Told, finished, judged, late, without
from ambient_trainer.estimators.kalman.observer_structure import ObserverStructure
from ambient_trainer.estimators.kalman.prior import believed_theta, walk_of
from ambient_trainer.estimators.kalman.walking_ambient import WalkingAmbient
from ambient_trainer.lti.reduce import reduced

Array = NDArray[np.float64]

CIRCUIT_OBSERVER = "circuit_observer"
_MOST_SENSORS = 8
_MOST_STATES = 4
_MOST_STARTS = 3
"""Held near what is believed, all starts end at one place; three show that they do."""


def fit_circuit_observer(
    traces: Sequence[Trace],
    effort: Effort,
    progress: Progress | None = None,
    period_s: float | None = None,
    inputs: Sequence[str] | None = None,
) -> Fit:
    """Fit the observer over ``inputs`` (trace columns; by default every temperature), and one without each of them.

    At most three of ``effort.starts`` are made. Raises :class:`Refused` for more sensors than any trace can tell.
    """
    columns, segments = estimator_data(traces, inputs, period_s, effort.pieces)
    if len(columns) > _MOST_SENSORS:
        problem = f"{len(columns)} temperatures make a circuit with more unknowns than any trace can tell"
        raise refuse(CIRCUIT_OBSERVER, "", problem, f"name the best {_MOST_SENSORS} or fewer with --sensors")
    with threadpool_limits(1):
        walk = walk_of(segments)
        circuit = WalkingAmbient(columns, walk)
        structure = ObserverStructure(circuit, believed_theta(circuit, segments), segments)
        require_enough(traces, structure)
        main = _fitted(columns, structure, replace(effort, starts=min(effort.starts, _MOST_STARTS)), progress)

        def fallback(dropped: int) -> Fit:
            left, parts = without(columns, segments, dropped)
            smaller = WalkingAmbient(left, walk)
            start = struck_out(circuit, smaller, np.log([each.value for each in main.parameters]), dropped)
            return _fitted(
                left,
                ObserverStructure(smaller, start, parts),
                replace(effort, starts=1, pieces=1),
                late(progress, effort),
            )

        states = len(columns) + 1
        remark = f"The circuit has {states} states: a node a sensor, and the ambient"
        remark += f"; balanced down to {len(main.states)}." if states > len(main.states) else "."
        return finished(Member(main, segments), fallback, Told(remark, {"states_of_circuit": states}))


def _fitted(columns: Sequence[str], structure: ObserverStructure, effort: Effort, progress: Progress | None) -> Fit:
    found = searched(structure, effort, progress)
    best, circuit = found.result.best, structure.circuit
    whole = circuit.filter(best.theta).system
    whole.offset[:] = best.beta
    system = reduced(whole, _MOST_STATES)
    values = zip(circuit.units.items(), np.exp(best.theta).tolist())
    fit = fit_of(
        found,
        system,
        tuple(estimated(name, unit, value, True, found.known) for (name, unit), value in values),
        circuit=CIRCUIT_OBSERVER,
        hold="first-order",
        inputs=tuple(columns),
        states=tuple(f"mode{index + 1}" for index in range(len(system.A))),
        outputs=("ambient",),
    )
    return judged(fit, structure.segments)


def struck_out(whole: WalkingAmbient, smaller: WalkingAmbient, theta: Array, dropped: int) -> Array:
    """The theta of the circuit that lacks a node, its capacities in terms of its own first one."""
    known = dict(zip(whole.names, theta.tolist()))
    first = known[whole.names[whole.count]] if dropped == 0 else 0.0
    shift = {"C": first, "g": first}
    return np.array([known[name] - shift.get(name.partition("_")[0], 0.0) for name in smaller.names])
