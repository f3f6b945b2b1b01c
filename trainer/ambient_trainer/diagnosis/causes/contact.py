"""A body with a temperature of its own holds on: a hand, a pocket, a table."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from ambient_trainer.diagnosis.candidate import Candidate, Estimate, Parameters, Setting, Span
from ambient_trainer.diagnosis.result import Cause, Magnitude
from ambient_trainer.diagnosis.terms import HeatTerm
from ambient_trainer.diagnosis.view import View

Array = NDArray[np.float64]

NAME = "contact"
_ABOUT_DEGC = 25.0
_COLDEST_DEGC, _HOTTEST_DEGC = -20.0, 60.0


def candidates(setting: Setting) -> Iterator[Candidate]:
    """Every node, from some moment to some other: heat G (T_body - T_i), linear in G and in G (T_body - 25)."""
    for node, name in enumerate(setting.plant.nodes):
        yield _held(setting, node, name)


def _held(setting: Setting, node: int, name: str) -> Candidate:
    scale, _ = setting.heat_unit(node)

    def terms(view: View) -> tuple[HeatTerm, ...]:
        return (
            HeatTerm(view.ones, setting.into(node, lambda nodes, air: _ABOUT_DEGC - nodes[node])),
            HeatTerm(view.ones, setting.into(node, lambda nodes, air: np.ones_like(air))),
        )

    def magnitude(found: Estimate) -> Magnitude:
        conductance, heat = found.values
        # the ratio's interval by the delta method
        slope = np.array([-heat / conductance**2, 1.0 / conductance])
        half = 1.96 * float(np.sqrt(max(slope @ found.covariance[:2, :2] @ slope, 0.0)))
        body = _body_degC(found)
        return Magnitude(body, "degC", f"temperature of the body at {name}", (body - half, body + half))

    def parameters(found: Estimate) -> Parameters:
        return {
            "body_temp": (_body_degC(found), "degC"),
            "conductance": (scale * float(found.values[0]), setting.conductance_unit),
        }

    return Candidate(
        Cause(NAME, name), Span.WINDOW, terms, magnitude, parameters, fixed=(None, None), plausible=_a_body
    )


def _body_degC(found: Estimate) -> float:
    return _ABOUT_DEGC + float(found.values[1] / found.values[0])


def _a_body(values: Array) -> NDArray[np.bool_]:
    conductance = values[..., 0]
    body = _ABOUT_DEGC + values[..., 1] / np.where(conductance > 0, conductance, np.inf)
    return np.asarray((conductance > 0) & (body > _COLDEST_DEGC) & (body < _HOTTEST_DEGC))
