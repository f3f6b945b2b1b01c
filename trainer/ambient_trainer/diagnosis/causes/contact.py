"""A body with a temperature of its own holds on: a hand, a pocket, a table."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ambient_trainer.diagnosis.candidate import Candidate, CauseKind, Estimate, Parameters, Setting, Span, constant
from ambient_trainer.diagnosis.result import Cause, Magnitude
from ambient_trainer.diagnosis.terms import HeatTerm
from ambient_trainer.diagnosis.view import View

Array = NDArray[np.float64]

_NAME = "contact"
_ABOUT_DEGC = 25.0
_COLDEST_DEGC, _HOTTEST_DEGC = -20.0, 60.0


def _candidates(setting: Setting) -> Iterator[Candidate]:
    """Every node, from an onset to an end: heat G (T_body - T_i), linear in G and in G (T_body - 25)."""
    for node, name in enumerate(setting.plant.nodes):
        yield _held(setting, node, name)


def _held(setting: Setting, node: int, name: str) -> Candidate:
    scale, _ = setting.heat_unit(node)

    def terms(view: View) -> tuple[HeatTerm, ...]:
        return (
            HeatTerm(view.ones, setting.into(node, lambda nodes, air: _ABOUT_DEGC - nodes[node])),
            HeatTerm(view.ones, setting.into(node, constant)),
        )

    def magnitude(estimate: Estimate) -> Magnitude:
        conductance, flow = estimate.values
        half = estimate.half_width(np.array([-flow / conductance**2, 1.0 / conductance]))
        body = _body_degC(estimate)
        return Magnitude(body, "degC", f"temperature of the body at {name}", (body - half, body + half))

    def parameters(estimate: Estimate) -> Parameters:
        conductance = scale * float(estimate.values[0])
        return {"body_temp": (_body_degC(estimate), "degC"), "conductance": (conductance, setting.conductance_unit)}

    return Candidate(
        Cause(_NAME, name), Span.WINDOW, terms, magnitude, parameters, fixed=(None, None), plausible=_a_body
    )


def _body_degC(estimate: Estimate) -> float:
    return _ABOUT_DEGC + float(estimate.values[1] / estimate.values[0])


def _a_body(values: Array) -> NDArray[np.bool_]:
    conductance = values[..., 0]
    body = _ABOUT_DEGC + values[..., 1] / np.where(conductance > 0, conductance, np.inf)
    return np.asarray((conductance > 0) & (body > _COLDEST_DEGC) & (body < _HOTTEST_DEGC))


KIND = CauseKind(
    _NAME,
    "the contact with a body of its own temperature",
    "a body holds on at {place}",
    _candidates,
    lambda cause: "a circuit needs the temperature of what touches it, which nothing logged",
    rank=30,
    heats=True,
)
