"""The thesis's tables 5.1 to 5.12, each figure as published and as found on the simulated phone."""

from collections.abc import Sequence

from ambient_model.model import LEVELS_PERCENT
from ambient_studies.thesis import published
from ambient_studies.thesis.published import MODELS, OURS, RELATED, SCENARIOS, VARIANTS, Result, method_name
from ambient_studies.thesis.rows import Row
from ambient_trainer.report import Section, Table

PUBLISHED, SIMULATED = "published", "simulated"

_NONE = "-"
_LARGE_DEGC, _HUGE_DEGC = 100.0, 1000.0


def scenario_sections(rows: Sequence[Row]) -> list[Section]:
    """A scenario's tables of errors and intervals, in the thesis's order; what it gives no figures of comes last."""
    return [
        _pair(scenario, [row for row in rows if row.scenario == scenario])
        for scenario in SCENARIOS
        if any(row.scenario == scenario for row in rows)
    ]


def overview_table(rows: Sequence[Row]) -> Table:
    """The RMSE of every method and variant in every scenario."""
    scenarios = [name for name in sorted(SCENARIOS) if any(row.scenario == name for row in rows)]
    by_place: dict[tuple[str, str, str], Row] = {(row.model, row.variant, row.scenario): row for row in rows}
    methods = [
        (model, variant)
        for model in (*MODELS, *RELATED, *OURS)
        for variant in VARIANTS
        if any((model, variant, scenario) in by_place for scenario in scenarios)
    ]
    shown = []
    for model, variant in methods:
        found = [by_place.get((model, variant, scenario)) for scenario in scenarios]
        figures = (_number(row.reproduced.rmse_degC if row and row.reproduced else None) for row in found)
        shown.append((method_name(model), VARIANTS[variant], *figures))
    caption = (
        "RMSE in degC by scenario, simulated. Corrected: the equations without their errata, fitted to simulated "
        "scenario 5. Non-causal: with an offset that is fitted to the scenario under evaluation. Published "
        "parameters: found on the thesis's phone, used on the simulated one. As printed: equations and parameters "
        f"with their errata. Ours: no part of the thesis; fitted to the same run. {_NONE}: no finite figure."
    )
    return Table(caption, ("method", "variant", *scenarios), tuple(shown), labels=2)


def _pair(scenario: str, rows: Sequence[Row]) -> Section:
    compared = [row for row in rows if row.model in MODELS and row.variant in ("corrected", "noncausal")]
    beside = [row for group in (RELATED, OURS) for row in rows if row.model in group]
    errors, intervals = published.TABLES.get(scenario, (None, None))
    known = errors is not None
    sources = ("publ.", "sim.") if known else ("sim.",)
    lines = [*compared, *beside]
    return Section(
        f"{SCENARIOS[scenario]} ({SIMULATED})",
        [
            Table(
                _caption(errors, "RMSE, MAE and MBE in degC, true minus estimate"),
                ("model", *(f"{each} {source}" for each in ("RMSE", "MAE", "MBE") for source in sources)),
                tuple((_label(row), *_errors(row, known)) for row in lines),
            ),
            Table(
                _caption(intervals, "where 50, 90 and 98 % of the errors lie in degC, if normally distributed"),
                ("model", "figures", *(f"{level} %" for level in LEVELS_PERCENT)),
                tuple(line for row in lines for line in _intervals(row)),
                labels=2,
            ),
        ],
    )


def _caption(number: int | None, what: str) -> str:
    if number is None:
        return f"{what[0].upper()}{what[1:]}. The thesis recorded this scenario and gives no figures of it."
    return f"Table 5.{number}: {what}."


def _label(row: Row) -> str:
    if row.variant == "noncausal":
        return f"{method_name(row.model)}, non-causal"
    if row.model == published.NONCAUSAL:
        return f"{method_name(row.model)}, causal"
    return method_name(row.model)


def _errors(row: Row, known: bool) -> list[str]:
    sources = (row.published, row.reproduced) if known else (row.reproduced,)
    names = ("rmse_degC", "mae_degC", "mbe_degC")
    return [_number(getattr(figures, name) if figures else None) for name in names for figures in sources]


def _intervals(row: Row) -> list[tuple[str, ...]]:
    lines = [(_label(row), PUBLISHED, *_bands(row.published))] if row.published else []
    return [*lines, ("" if lines else _label(row), SIMULATED, *_bands(row.reproduced))]


def _bands(figures: Result | None) -> list[str]:
    if figures is None:
        return [_NONE for _ in LEVELS_PERCENT]
    bands = (figures.interval_degC[level] for level in LEVELS_PERCENT)
    return [f"{_number(low)} to {_number(high)}" for low, high in bands]


def _number(value: float | None) -> str:
    if value is None:
        return _NONE
    if abs(value) >= _HUGE_DEGC:
        return f"{value:.0e}"
    return f"{value:.2f}" if abs(value) < _LARGE_DEGC else f"{value:.1f}"
