"""The limits in words: a table, a sentence a scenario, and the same for a machine."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ambient_model.model import Model
from ambient_studies.lower_bound.limit import Limit, Seeds
from ambient_trainer.report.table import Table


def limit_table(model: Model, found: Sequence[Limit]) -> Table:
    """The model and the filters of each scenario."""
    rows = []
    for limit in found:
        rows.append((limit.scenario, model.name, str(len(model.main.inputs)), "", f"{limit.model_rmse_degC:.3f}", ""))
        rows += [
            ("", each.name, str(each.reads), str(each.weights), f"{each.rmse_degC:.3f}", f"{limit.ratio(each):.2f}")
            for each in limit.filters
        ]
    caption = (
        "RMSE in degC, simulated. The filters were fitted to other runs of the scenario itself. Weights: how many "
        "numbers were fitted. Ratio: the model's error over the filter's."
    )
    return Table(caption, ("scenario", "filter", "sensors", "weights", "RMSE", "ratio"), tuple(rows), labels=2)


def sentences(found: Sequence[Limit]) -> list[str]:
    """A sentence a scenario, and a word of caution where a filter has learned too little."""
    told = []
    for limit in found:
        own = limit.filters[0]
        told.append(
            f"Scenario {limit.scenario}: the model is {limit.model_rmse_degC:.3f} degC off, {limit.ratio(own):.2f} "
            f"times what a {own.name} over the same sensors leaves that was fitted to the scenario itself."
        )
        behind = [each.name for each in limit.filters if each.rmse_degC > limit.model_rmse_degC]
        if behind:
            told.append(f"  Worse than the model, so no limit: {', '.join(behind)}. More runs teach more: --fitted.")
    return told


def as_json(model: Model, found: Sequence[Limit], seeds: Seeds) -> dict[str, Any]:
    """All figures."""
    return {
        "simulated": True,
        "model": model.name,
        "seeds": {"fitted": list(seeds.fitted), "scored": list(seeds.scored)},
        "scenarios": [
            {
                "scenario": limit.scenario,
                "samples": limit.samples,
                "model_rmse_degC": limit.model_rmse_degC,
                "filters": [
                    {
                        "name": each.name,
                        "sensors": each.reads,
                        "weights": each.weights,
                        "rmse_degC": each.rmse_degC,
                        "ratio": limit.ratio(each),
                    }
                    for each in limit.filters
                ],
            }
            for limit in found
        ],
    }
