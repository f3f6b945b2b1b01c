"""The whole: simulate, train on scenario 5, evaluate on all others, compare with what was published."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from ambient_studies.reproduce.observers import observer_methods
from ambient_studies.reproduce.rows import Evaluated, Results, Row, evaluate
from ambient_studies.reproduce.runs import Progress, Runs, simulated_runs
from ambient_studies.reproduce.verdict import Verdict, verdict
from ambient_studies.thesis.errata import Erratum, computed_errata
from ambient_studies.thesis.methods import thesis_methods
from ambient_studies.thesis.published import Result
from ambient_trainer.estimators.method import Method

GatherMethods = Callable[[Runs, Progress], Sequence[Method]]


@dataclass(frozen=True)
class Reproduction:
    """Everything that tables, page and JSON are made of."""

    seed: int
    runs: Runs
    methods: Sequence[Method]
    evaluated: Evaluated
    verdict: Verdict


def reproduce(seed: int, gather: GatherMethods, published: Results, progress: Progress) -> Reproduction:
    """Run it with simulations from ``seed``; ``gather`` trains the methods."""
    runs = simulated_runs(seed, progress)
    methods = gather(runs, progress)
    evaluated = evaluate(methods, runs.evaluated, published, progress)
    return Reproduction(seed, runs, methods, evaluated, verdict(evaluated.rows))


def all_methods(runs: Runs, progress: Progress) -> list[Method]:
    """The thesis's ten models in all their variants, the four related methods and our observers, trained."""
    # support vectors take a second to import, and nothing else needs them
    from ambient_studies.related.methods import related_methods

    thesis = thesis_methods(runs.training, lambda model, done, total: progress(f"fitting {model}", done, total))
    progress("fitting the related methods", 0, 1)
    related = related_methods(runs.training, runs.idle)
    return [*thesis, *related, *observer_methods(runs.training, progress)]


def errata_of(runs: Runs, progress: Progress) -> list[Erratum]:
    """What the thesis's text gets wrong, computed from its tables and from ``runs``."""
    progress("computing the errata", 0, 1)
    return computed_errata(runs.training, runs.evaluated["3"])


def as_json(reproduction: Reproduction, errata: Sequence[Erratum]) -> dict[str, Any]:
    """The content of ``reproduce --json``."""
    found = reproduction.verdict
    return {
        "simulated": True,
        "seed": reproduction.seed,
        "spearman": found.spearman,
        "spearman_causal": found.spearman_causal,
        "compared": found.compared,
        "within_factor_two": found.within_factor_two,
        "headline": found.headline,
        "shortfalls": list(found.shortfalls),
        "rows": [_row(row) for row in reproduction.evaluated.rows],
        "errata": [_erratum(each) for each in errata],
        "methods": [
            {"model": each.name, "variant": each.variant, "about": each.about} for each in reproduction.methods
        ],
    }


def _erratum(erratum: Erratum) -> dict[str, Any]:
    figures = [{"what": what, "value": value, "unit": unit} for what, value, unit in erratum.figures]
    return {"number": erratum.number, "title": erratum.title, "statement": erratum.statement, "figures": figures}


def _row(row: Row) -> dict[str, Any]:
    return {
        "scenario": row.scenario,
        "model": row.model,
        "variant": row.variant,
        "published": _figures(row.published),
        "reproduced": _figures(row.reproduced),
        "samples": row.samples,
        "without_estimate": row.without_estimate,
    }


def _figures(figures: Result | None) -> dict[str, Any] | None:
    if figures is None:
        return None
    return {
        **asdict(figures),
        "interval_degC": {str(level): list(band) for level, band in figures.interval_degC.items()},
    }
