"""What a fit has to say, for the terminal and for a machine."""

from __future__ import annotations

import math
from typing import Any

from ambient_trainer.estimators.base import Fit, Parameter
from ambient_trainer.report.table import Table

_FACTS = ("converged", "uncertainty_available", "identifiable")


def as_json(fit: Fit) -> dict[str, Any]:
    """The content of ``fit --json``; what the data do not give is null."""
    return {
        "circuit": fit.circuit,
        "inputs": list(fit.inputs),
        "states": list(fit.states),
        "outputs": list(fit.outputs),
        "periods_s": list(fit.periods_s),
        "samples": fit.samples,
        "rmse_degC": fit.rmse_degC,
        **{fact: getattr(fit, fact) for fact in _FACTS},
        "stopped": fit.stopped,
        "confounded": [list(each) for each in fit.confounded],
        "residual_memory_samples": fit.residual_memory_samples,
        "evaluations": fit.evaluations,
        "start_rmses_degC": list(fit.start_rmses_degC),
        "parameters": [_parameter(each) for each in fit.parameters],
        "dc_gains": dict(zip(fit.inputs, fit.dc_gains)),
        "baseline": {"kind": "static linear", "rmse_degC": fit.baseline.rmse_degC},
        "notes": list(fit.notes),
        **fit.details,
    }


def headline(fit: Fit) -> str:
    """The error and what to hold it against."""
    periods = " or ".join(f"{each:g}" for each in fit.periods_s)
    return (
        f"{fit.circuit}: RMSE {fit.rmse_degC:.3f} degC on its own {fit.samples:,} training samples "
        f"(one every {periods} s), where a static linear formula leaves {fit.baseline.rmse_degC:.3f}."
    )


def facts(fit: Fit) -> list[str]:
    """One line each: converged, uncertainty available, identifiable, and what else a user must know."""
    agreeing = sum(each <= 1.01 * fit.rmse_degC for each in fit.start_rmses_degC)
    lines = [
        f"Converged: {_yes(fit.converged)}; {agreeing} of {len(fit.start_rmses_degC)} starts came within 1 % of the "
        f"best, in {fit.evaluations} evaluations.",
        f"Uncertainty available: {_yes(fit.uncertainty_available)}; the residuals remember "
        f"{fit.residual_memory_samples:.1f} samples (1 is white).",
        f"Identifiable: {_yes(fit.identifiable)}"
        + ("." if fit.identifiable else "; these data tell only products of:"),
    ]
    lines += [f"  {', '.join(each)}" for each in fit.confounded]
    if fit.stopped:
        lines.insert(0, "Stopped before the search was over: this is the best so far.")
    if fit.rmse_degC > fit.baseline.rmse_degC:
        lines.append("It loses to the static formula on the data it was fitted to: this circuit does not suit them.")
    gain = sum(abs(each) for each in fit.dc_gains)
    if gain > 5:
        lines.append(
            f"At rest the sensors' gains add up to {gain:.1f} in absolute value: large opposite gains that amplify "
            "noise and every cold start. --pieces 12 or a trace that comes to rest keeps them small."
        )
    return [*lines, *fit.notes]


def parameter_table(fit: Fit) -> Table:
    """One row a parameter."""
    rows = tuple((each.name, f"{each.value:.4g}", each.unit, _interval(each), _note(each)) for each in fit.parameters)
    return Table("", ("parameter", "value", "unit", "95 % interval", ""), rows)


def _parameter(each: Parameter) -> dict[str, Any]:
    return {
        "name": each.name,
        "unit": each.unit,
        "value": each.value,
        "standard_error": _finite(each.standard_error),
        "interval95": None if each.interval95 is None else [_finite(end) for end in each.interval95],
        "free": each.free,
        "at_bound": each.at_bound,
        "identifiable": each.identifiable,
    }


def _finite(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None


def _interval(each: Parameter) -> str:
    return "" if each.interval95 is None else f"{each.interval95[0]:.4g} to {each.interval95[1]:.4g}"


def _note(each: Parameter) -> str:
    if not each.free:
        return "fixed"
    if each.at_bound:
        return "at its bound"
    return "" if each.identifiable else "not identifiable"


def _yes(fact: bool) -> str:
    return "yes" if fact else "no"
