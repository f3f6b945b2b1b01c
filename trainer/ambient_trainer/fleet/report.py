"""The report of a fleet: its population, errors under the three ways of pooling, and units that do not fit it."""

from functools import partial
from typing import Any

import numpy as np
import pandas as pd

from ambient_trainer.estimators.model_file import MAIN
from ambient_trainer.fleet.causes import Outlier
from ambient_trainer.fleet.run import FleetFit
from ambient_trainer.report import Block, Facts, Figure, Finding, Plot, Report, Section, Table
from ambient_trainer.report.palette import BASELINE, ERROR, ESTIMATE, GREY, LIMIT
from ambient_trainer.report.plots import add_curve, panel_figure

_WAYS = {"pooled": BASELINE, "separate": ERROR, "partial": ESTIMATE}
_SHARES = (50, 90, 100)
_SHOWN = 20


def report_of(fleet: FleetFit) -> Report:
    """What a fleet's run shows."""
    table, population = fleet.table, fleet.population
    good, failed = table[table["status"] != "failed"], fleet.failed
    errors = {way: good[f"rmse_{way}_degC"].to_numpy() for way in _WAYS}
    median = {way: f"{np.median(each):.2f} degC" for way, each in errors.items()}
    ways = "Complete pooling leaves {pooled}, no pooling {separate}, partial pooling {partial}"
    result = Finding(f"{ways.format(**median)} (RMSE, median unit).", "result")
    broken = Finding(f"{len(failed)} of {len(table)} units failed; the table has the reasons.", "warning")
    shares = {way: np.percentile(each, _SHARES) for way, each in errors.items()}
    rows = [(way, *(f"{value:.2f}" for value in each)) for way, each in shares.items()]
    names = fleet.start.spaces[MAIN].parameters[0]
    gains = [(name, *(f"{value:.3f}" for value in np.percentile(good[name], (5, 50, 95)))) for name in names]
    lost = {str(unit): reason for unit, reason in zip(failed["unit"], failed["reason"])}
    more = f"{len(failed) - _SHOWN} more in fleet.parquet" if len(failed) > _SHOWN else ""
    facts = [
        ("inputs", ", ".join(fleet.start.fit.inputs)),
        ("initialised with", ", ".join(fleet.start.units)),
        ("groups", ", ".join("/".join(each) for each in fleet.groups if each) or "none"),
    ]
    blocks: list[Block] = [
        Table("RMSE in degC", ("pooling", "median", "90 % of units", "worst"), rows),
        Figure(partial(_errors, errors), "Distribution of the units' errors for each kind of pooling."),
    ]
    about = "Units by parameter, about the median, over the interquartile range."
    parameters: list[Block] = [
        Table("", ("", "", ""), _hyperparameters(fleet, good)),
        Table("DC gains, and the offset", ("parameter", "5 %", "median", "95 %"), gains, 1),
        Figure(partial(_distributions, good, names), about),
        Figure(partial(_map, fleet, good, names), "Each unit; outliers are named."),
    ]
    outliers = Table("", ("unit", "probability", "cause", "confidence"), list(map(_outlier, fleet.outliers)))
    failures = Table(more, ("unit", "reason"), list(lost.items())[:_SHOWN], labels=2)
    return Report(
        subject="A fleet",
        title=f"{fleet.circuit}, {len(good)} units: {median['partial']} on blocks held out (median)",
        lead=[result, broken if lost else None, Facts(facts)],
        sections=[
            Section("Errors on blocks held out", blocks),
            Section("The population", parameters),
            Section("Outliers", [outliers]),
            Section("Units that failed", [failures] if lost else []),
        ],
        data={
            "units": len(table),
            "failed": lost,
            "rmse_degC": {way: dict(zip(map(str, _SHARES), each.tolist())) for way, each in shares.items()},
            "population": population.summary,
            "outliers": [each._asdict() for each in fleet.outliers],
        },
    )


def _hyperparameters(fleet: FleetFit, good: pd.DataFrame) -> list[tuple[str, str, str]]:
    summary = fleet.population.summary
    return [
        ("between units", f"{summary['between_units_degC']:.2f}", "degC, standard deviation of the estimate"),
        ("noise", f"{summary['noise_degC']:.2f}", "degC, standard deviation of the residual"),
        ("autocorrelation time", f"{summary['memory_s']:.0f}", "s, of the residual"),
        ("effective samples", f"{good['effective_samples'].median():.1f}", "per unit (median)"),
        ("shrinkage", f"{good['shrinkage'].median():.2f}", "median over units; 1 is the population's value"),
        ("unseen unit", f"{1.645 * fleet.population.unseen_degC:.2f}", "degC, half the 90 % interval"),
    ]


def _outlier(each: Outlier) -> tuple[str, str, str, str]:
    named = " at ".join(part for part in (each.cause, each.location) if part)
    sure = "" if each.confidence is None else f"{100 * each.confidence:.0f} %"
    cause = f"{named}, or {each.rivals}" if each.rivals else named
    return each.unit, f"10^-{each.improbability:.1f}", cause, sure


def _errors(errors: dict[str, Any]) -> Plot:
    figure = panel_figure("share of units, %", "RMSE in degC", 320)
    for way, colour in _WAYS.items():
        # two hundred points show ten thousand units as well as all of them
        share = np.linspace(0, 100, 201)
        add_curve(figure, share.tolist(), np.percentile(errors[way], share).tolist(), way, colour)
    figure.update_traces(mode="lines")
    figure.update_yaxes(type="log")
    return figure


def _distributions(good: pd.DataFrame, names: tuple[str, ...]) -> Plot:
    figure = panel_figure("parameter", "(value - median) / (interquartile range)", 340)
    for name in names:
        values = good[name].to_numpy()
        low, middle, high = np.percentile(values, [25, 50, 75])
        shown = np.percentile((values - middle) / max(high - low, 1e-12), np.linspace(0, 100, 201))
        label = name.replace("_degC", "")
        figure.add_violin(y=shown, name=label, line={"color": ESTIMATE}, points=False, showlegend=False)
    figure.update_xaxes(automargin=True)
    return figure


def _map(fleet: FleetFit, good: pd.DataFrame, names: tuple[str, ...]) -> Plot:
    """The two directions in which the parameters vary most."""
    import plotly.graph_objects as go

    values = good[list(names)].to_numpy()
    scale = np.maximum(np.std(values, axis=0), 1e-12)
    U, singular, _ = np.linalg.svd((values - np.median(values, axis=0)) / scale, full_matrices=False)
    x, y = np.round(U[:, :2] * singular[:2], 3).T
    figure = panel_figure("first principal component", "second", 420)
    units, grey = good["unit"].to_numpy(), {"color": GREY, "size": 4}
    figure.add_trace(go.Scattergl(x=x, y=y, mode="markers", name="units", text=units, marker=grey))
    odd = good["unit"].isin([each.unit for each in fleet.outliers if each.improbability > 3]).to_numpy()
    named = {"mode": "markers+text", "textposition": "top center", "marker": {"color": LIMIT, "size": 8}}
    figure.add_trace(go.Scatter(x=x[odd], y=y[odd], name="outliers", text=units[odd], **named))
    return figure
