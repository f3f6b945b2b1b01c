"""Whether the thesis's models fare on the simulated phone as they did on the real one: rank correlation of RMSE."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import spearmanr
from threadpoolctl import threadpool_limits

from ambient_studies.calibration.published import published_errors
from ambient_studies.thesis.methods import MODELS, NONCAUSAL, Progress, thesis_methods
from ambient_trainer.report.table import Table
from ambient_trainer.simulator.device import Chamber, Phone
from ambient_trainer.simulator.phone import simulate_many

TRAINING = "5"
SCENARIOS = ("1", "2.1", "2.3", "2.4", "3", "4")


@dataclass(frozen=True)
class Ranked:
    """One model's RMSE in one scenario: as published, and on the simulated phone, trained there on scenario 5."""

    scenario: str
    model: str
    published_degC: float
    simulated_degC: float


def ranked(phone: Phone, chamber: Chamber, seed: int, progress: Progress | None = None) -> list[Ranked]:
    """The 60 rows; training and evaluation have seeds of their own, model1_ss_single_input is the noncausal one."""
    runs = [(TRAINING, seed), *((name, seed + 1) for name in SCENARIOS)]
    training, *evaluated = simulate_many(runs, phone=phone, chamber=chamber)
    with threadpool_limits(1):
        methods = {(each.name, each.variant): each for each in thesis_methods(training, progress)}
    rows = []
    for scenario, trace in zip(SCENARIOS, evaluated):
        for model in MODELS:
            method = methods[model, "noncausal" if model == NONCAUSAL else "corrected"]
            error = trace.reference - method.estimate(trace)
            rmse = float(np.sqrt(np.nanmean(error**2)))
            rows.append(Ranked(scenario, model, published_errors()[scenario, model].rmse_degC, rmse))
    return rows


def rank_correlation(rows: Sequence[Ranked]) -> float:
    """Spearman's, between published and simulated."""
    published, simulated = zip(*((each.published_degC, each.simulated_degC) for each in rows))
    return float(spearmanr(published, simulated).statistic)


def rank_table(rows: Sequence[Ranked]) -> Table:
    """Models by scenarios: published / simulated RMSE in degC."""
    cells = {(each.model, each.scenario): f"{each.published_degC:.2f} / {each.simulated_degC:.2f}" for each in rows}
    caption = f"RMSE in degC, published / simulated. Spearman's rank correlation: {rank_correlation(rows):.3f}."
    body = tuple((model, *(cells[model, scenario] for scenario in SCENARIOS)) for model in MODELS)
    return Table(caption, ("model", *SCENARIOS), body)
