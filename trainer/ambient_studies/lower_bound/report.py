"""The report of the lower bounds: a table, a sentence a scenario, and a warning where a filter is no bound."""

from collections.abc import Iterator, Sequence
from dataclasses import asdict
from typing import Any

from ambient_model.model import Model
from ambient_studies.lower_bound.study import Bound, Seeds
from ambient_trainer.report import Finding, Report, Section, Table

_CAPTION = (
    "RMSE in degC, simulated. The filters were fitted to other runs of the scenario itself. Weights: how many numbers "
    "were fitted. Ratio: the model's error over the filter's."
)


def report_of(model: Model, found: Sequence[Bound], seeds: Seeds) -> Report:
    """What the bounds of ``model`` show."""
    ratios = ", ".join(f"{each.ratio(each.filters[0]):.2f} in scenario {each.scenario}" for each in found)
    columns = ("scenario", "filter", "sensors", "weights", "RMSE", "ratio")
    rows = []
    for each in found:
        inputs = str(len(model.main.inputs))
        rows.append((each.scenario, model.name, inputs, "", f"{each.model_rmse_degC:.3f}", ""))
        for one in each.filters:
            figures = (f"{one.rmse_degC:.3f}", f"{each.ratio(one):.2f}")
            rows.append(("", one.name, str(one.sensors), str(one.weights), *figures))
    return Report(
        subject="Linear lower bound, simulated",
        title=f"{model.name}: times the error of a linear filter fitted to the scenario itself, {ratios}",
        lead=[],
        sections=[Section("", [Table(_CAPTION, columns, rows, labels=2)]), Section("", list(_findings(found)))],
        data=as_json(model, found, seeds),
    )


def as_json(model: Model, found: Sequence[Bound], seeds: Seeds) -> dict[str, Any]:
    """All figures."""
    scenarios = [
        {**asdict(each), "filters": [{**asdict(one), "ratio": each.ratio(one)} for one in each.filters]}
        for each in found
    ]
    return {"simulated": True, "model": model.name, "seeds": asdict(seeds), "scenarios": scenarios}


def _findings(found: Sequence[Bound]) -> Iterator[Finding]:
    for each in found:
        own = each.filters[0]
        yield Finding(
            f"Scenario {each.scenario}: the model's error is {each.model_rmse_degC:.3f} degC, {each.ratio(own):.2f} "
            f"times that of a {own.name} over the same sensors that was fitted to the scenario itself."
        )
        behind = [one.name for one in each.filters if one.rmse_degC > each.model_rmse_degC]
        if behind:
            text = f"Worse than the model, so no bound: {', '.join(behind)}. Fit them to more runs with `--fitted`."
            yield Finding(text, "warning")
