"""The reproduction as one page: what was published, what the simulated phone gives, and every figure."""

from __future__ import annotations

from collections.abc import Sequence

from ambient_studies.thesis.errata import Erratum
from ambient_studies.thesis.figures import (
    Drawn,
    display_on_and_off,
    estimate_figures,
    raw_sensors,
    scatter,
    youtube,
)
from ambient_studies.thesis.names import VARIANTS, method_name
from ambient_studies.thesis.outcome import outcome_table, outcomes
from ambient_studies.thesis.reproduction import TRAINING, Reproduction
from ambient_studies.thesis.tables import overview_table, scenario_tables
from ambient_trainer.report.page import render
from ambient_trainer.report.plots import POINTS_PER_LINE, to_markup
from ambient_trainer.report.table import Table
from ambient_trainer.simulator.device import Chamber, Phone, with_values
from ambient_trainer.simulator.phone import simulate, simulate_zones

_LOADED = "2.1"
_DISPLAY_W = 0.4
"""Heat of a display at full brightness; chosen, somewhat above what streaming takes."""


def reproduction_page(reproduction: Reproduction, errata: Sequence[Erratum]) -> str:
    """The page as HTML.

    Simulates the runs that figures 4.1 and 4.5 and the residuals of the calibration need besides.
    """
    rows = reproduction.evaluated.rows
    tables = scenario_tables(rows)
    return render(
        "reproduce.html",
        facts=_facts(reproduction),
        headline=reproduction.verdict.headline,
        shortfalls=reproduction.verdict.shortfalls,
        scatter=to_markup(scatter(rows), "scatter"),
        verification=tables[0],
        others=tables[1:],
        overview=overview_table(rows),
        figures=[
            {**each._asdict(), "plot": to_markup(each.figure, f"figure-{each.number.replace('.', '-')}")}
            for each in _figures(reproduction)
        ],
        errata=[(each, _erratum_table(each)) for each in errata],
        calibration=outcome_table(outcomes(Phone.shipped(), Chamber.shipped(), reproduction.seed)),
        methods=[(f"{method_name(each.name)}, {VARIANTS[each.variant]}", each.about) for each in reproduction.methods],
        points=f"{POINTS_PER_LINE:,}",
    )


def _figures(reproduction: Reproduction) -> list[Drawn]:
    evaluated, seed = reproduction.runs.evaluated, reproduction.seed
    loaded = simulate_zones(_LOADED, seed)
    lit = with_values(Phone.shipped(), {"power_W.idle.display": _DISPLAY_W, "power_W.cpu_100.display": _DISPLAY_W})
    return [
        raw_sensors(loaded),
        display_on_and_off(loaded, simulate(_LOADED, seed, phone=lit), _DISPLAY_W),
        *estimate_figures(evaluated["4"], reproduction.evaluated.estimates),
        youtube(evaluated["2.4"]),
    ]


def _facts(reproduction: Reproduction) -> list[tuple[str, str]]:
    training = reproduction.runs.training
    hours = (training.time_s[-1] - training.time_s[0]) / 3600
    return [
        ("trained on", f"scenario {TRAINING}, simulated, {hours:.1f} h, {len(training.time_s):,} samples"),
        ("evaluated on", f"scenarios {', '.join(reproduction.runs.evaluated)}, simulated with other weather and noise"),
        ("estimates", "causal, from the first sensor sample on, but where they are called non-causal"),
        ("seed", str(reproduction.seed)),
    ]


def _erratum_table(erratum: Erratum) -> Table:
    rows = [(each.what, f"{each.value:.4g} {each.unit}") for each in erratum.figures]
    return Table("", ("figure", "value"), tuple((_shown(what), _shown(value)) for what, value in rows))


def _shown(text: str) -> str:
    return text.replace("degC", "°C")
