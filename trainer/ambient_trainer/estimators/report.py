"""The report of a fit: its error beside the static formula's, its parameters, and what the data determine."""

from typing import Any

from ambient_trainer.estimators.base import Fit
from ambient_trainer.report import Facts, Finding, Report, Section, Table
from ambient_trainer.report.files import finite

_AS_THEY_ARE = (
    *("circuit", "inputs", "states", "outputs", "periods_s", "samples", "rmse_degC", "converged"),
    *("uncertainty_available", "identifiable", "stopped", "confounded", "residual_memory_samples", "evaluations"),
    *("start_rmses_degC", "notes"),
)
"""Of a fit, in its JSON."""
_LARGE_GAINS = 5.0
"""Of a sum of absolute DC gains. An average of sensors has 1, the thesis's circuits at most 3: beyond, noise grows."""


def report_of(fit: Fit) -> Report:
    """The report of a fit."""
    periods = " or ".join(f"{each:g}" for each in fit.periods_s)
    rows = []
    for each in fit.parameters:
        interval = "" if each.interval95 is None else f"{each.interval95[0]:.4g} to {each.interval95[1]:.4g}"
        note = "at its bound" if each.at_bound else "" if each.identifiable else "not identifiable"
        rows.append((each.name, f"{each.value:.4g}", each.unit, interval, note if each.free else "fixed"))
    table = Table("", ("parameter", "value", "unit", "95 % interval", ""), rows)
    return Report(
        subject="Fit",
        title=f"{fit.circuit}: RMSE {fit.rmse_degC:.3f} degC on {fit.samples:,} training samples",
        lead=[
            Finding("Stopped before the search was over: this is the best so far.", "warning") if fit.stopped else None,
            Finding(f"A static linear formula leaves {fit.baseline.rmse_degC:.3f} degC on the same samples."),
            Facts([("inputs", ", ".join(fit.inputs)), ("states", ", ".join(fit.states)), ("periods", f"{periods} s")]),
        ],
        sections=[Section("Parameters", [table]), Section("What the data determine", findings(fit))],
        data=as_json(fit),
    )


def as_json(fit: Fit) -> dict[str, Any]:
    """The content of ``fit --json``; what the data do not give is null."""
    return {
        **{name: getattr(fit, name) for name in _AS_THEY_ARE},
        "parameters": [finite(each._asdict()) for each in fit.parameters],
        "dc_gains": dict(zip(fit.inputs, fit.dc_gains)),
        "baseline": {"kind": "static linear", "rmse_degC": fit.baseline.rmse_degC},
        **fit.details,
    }


def findings(fit: Fit) -> list[Finding]:
    """Converged, uncertainty available, identifiable, and the remarks of this kind of estimator."""
    yes = {True: "yes", False: "no"}
    agreeing = sum(each <= 1.01 * fit.rmse_degC for each in fit.start_rmses_degC)
    mixed = [each for each in fit.confounded if len(each) > 1]
    vague = {each.name for each in fit.parameters if not each.identifiable}.union(*fit.confounded).difference(*mixed)
    open_ = {"determine only products of: ": map(", ".join, mixed), "do not bound ": [", ".join(sorted(vague))]}
    shown = " and ".join(what + named for what, names in open_.items() if (named := "; ".join(names)))
    gain = sum(abs(each) for each in fit.dc_gains)
    lines = [
        f"Converged: {yes[fit.converged]}; {agreeing} of {len(fit.start_rmses_degC)} starts came within 1 % of the "
        f"best, in {fit.evaluations} evaluations.",
        f"Uncertainty available: {yes[fit.uncertainty_available]}; the residuals' autocorrelation time is "
        f"{fit.residual_memory_samples:.1f} samples (1 is white).",
        f"Identifiable: {yes[fit.identifiable]}" + ("." if fit.identifiable else f"; these data {shown}."),
        *fit.notes,
    ]
    found = [Finding(line) for line in lines]
    if fit.rmse_degC > fit.baseline.rmse_degC:
        found.append(Finding("The static formula is better on the training data: this circuit does not suit them."))
    if gain > _LARGE_GAINS:
        others = "or fewer sensors," if fit.effort.pieces > 1 else "fewer sensors or --pieces 12"
        text = (
            f"The sensors' DC gains add up to {gain:.1f} in absolute value: large opposite gains amplify noise and "
            f"every cold start. A trace that reaches a steady state, {others} may keep them small."
        )
        found.append(Finding(text))
    return found
