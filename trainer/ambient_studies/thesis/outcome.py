"""How well the simulated phone meets the published figures, from the traces that it writes."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from threadpoolctl import threadpool_limits

from ambient_studies import Progress
from ambient_studies.thesis.methods import thesis_methods
from ambient_studies.thesis.published import CONSTANT_SCENARIOS, MODELS, published_results, sensor_statistics
from ambient_studies.thesis.rows import Row, evaluate, like_published, spearman
from ambient_trainer.report import Finding, Report, Section, Table
from ambient_trainer.simulator import Device, simulate_many

MEAN_BAR_DEGC = 1.0
STD_BAR_FRAC = 0.3
_RANKED = ("1", "2.1", "2.3", "2.4", "3", "4")


@dataclass(frozen=True)
class Outcome:
    """One recovered figure beside the simulated one, in degC."""

    scenario: str
    sensor: str
    figure: str
    published_degC: float
    simulated_degC: float

    @property
    def difference_degC(self) -> float:
        """Simulated minus published."""
        return self.simulated_degC - self.published_degC

    @property
    def within(self) -> bool:
        """Whether it is within the bar: 1 degC for a mean, 30 % for a standard deviation."""
        bar = MEAN_BAR_DEGC if self.figure == "mean" else STD_BAR_FRAC * self.published_degC
        return abs(self.difference_degC) <= bar


def outcomes(device: Device, seed: int) -> list[Outcome]:
    """Every published statistic of a raw sensor beside that of the simulated phone's trace."""
    runs = [(name, seed) for name in CONSTANT_SCENARIOS]
    traces = {name: run.trace for name, run in zip(CONSTANT_SCENARIOS, simulate_many(runs, device=device))}
    found = []
    for (scenario, sensor), published in sensor_statistics().items():
        values = traces[scenario].column(f"{sensor}_degC")
        found.append(Outcome(scenario, sensor, "mean", published.mean_degC, float(values.mean())))
        if published.std_degC is not None:
            found.append(Outcome(scenario, sensor, "std", published.std_degC, float(values.std())))
    return found


def report_of(compared: Sequence[Outcome], rows: Sequence[Row], fitted: str = "") -> Report:
    """The residuals of the calibration and the ranks of the models' errors; ``fitted`` names the search's result."""
    return Report(
        subject="Calibration of the simulated phone",
        title=f"{sum(each.within for each in compared)} of {len(compared)} published figures within the bar",
        lead=[Finding(fitted, "result") if fitted else None],
        sections=[Section("", [outcome_table(compared), rank_table(rows)])],
        data={},
    )


def outcome_table(found: Sequence[Outcome]) -> Table:
    """The residuals of the calibration, one a row."""
    columns: dict[str, Callable[[Outcome], str]] = {
        "scenario": lambda each: each.scenario,
        "sensor": lambda each: each.sensor,
        "figure": lambda each: each.figure,
        "published": lambda each: f"{each.published_degC:.2f}",
        "simulated": lambda each: f"{each.simulated_degC:.2f}",
        "difference": lambda each: f"{each.difference_degC:+.2f}",
        "within": lambda each: "yes" if each.within else "NO",
    }
    caption = (
        f"degC. Within the bar ({MEAN_BAR_DEGC:g} degC for a mean, {STD_BAR_FRAC:.0%} for a standard deviation): "
        f"{sum(each.within for each in found)} of {len(found)}."
    )
    return Table(caption, [*columns], [[of(each) for of in columns.values()] for each in found])


def ranked(device: Device, seed: int, progress: Progress) -> list[Row]:
    """The thesis's 60 errors, simulated: trained on scenario 5 with ``seed``, evaluated with the one after it."""
    runs = [("5", seed), *((name, seed + 1) for name in _RANKED)]
    training, *evaluated = (run.trace for run in simulate_many(runs, device=device))
    with threadpool_limits(1):
        methods = thesis_methods(training, progress)
    compared = [each for each in methods if each.variant in ("corrected", "noncausal")]
    return like_published(evaluate(compared, dict(zip(_RANKED, evaluated)), published_results(), progress).rows)


def rank_table(rows: Sequence[Row]) -> Table:
    """Models by scenarios: published / simulated RMSE in degC."""
    cells = {
        (row.model, row.scenario): f"{row.published.rmse_degC:.2f} / {row.reproduced.rmse_degC:.2f}"
        for row in rows
        if row.published and row.reproduced
    }
    caption = f"RMSE in degC, published / simulated. Spearman's rank correlation: {spearman(rows) or 0.0:.3f}."
    body = tuple((model, *(cells.get((model, scenario), "-") for scenario in _RANKED)) for model in MODELS)
    return Table(caption, ("model", *_RANKED), body)
