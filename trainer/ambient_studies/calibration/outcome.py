"""How well the simulated phone meets the published figures, good or bad, from the traces that it really writes."""

from __future__ import annotations

from dataclasses import dataclass

from ambient_studies.calibration.published import CONSTANT_SCENARIOS, sensor_figures
from ambient_trainer.report.table import Table
from ambient_trainer.simulator.device import Chamber, Phone
from ambient_trainer.simulator.phone import simulate_many

MEAN_BAR_DEGC = 1.0
STD_BAR_FRAC = 0.3


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


def outcomes(phone: Phone, chamber: Chamber, seed: int) -> list[Outcome]:
    """Every recovered figure; what was published stands beside what the sensors of a simulated phone report."""
    runs = [(name, seed) for name in CONSTANT_SCENARIOS]
    traces = dict(zip(CONSTANT_SCENARIOS, simulate_many(runs, phone=phone, chamber=chamber)))
    found = []
    for each in sensor_figures():
        values = traces[each.scenario].column(f"{each.sensor}_degC")
        found.append(Outcome(each.scenario, each.sensor, "mean", each.mean_degC, float(values.mean())))
        if each.std_degC is not None:
            found.append(Outcome(each.scenario, each.sensor, "std", each.std_degC, float(values.std())))
    return found


def outcome_table(found: list[Outcome]) -> Table:
    """The residuals of the calibration, one a row."""
    rows = tuple(
        (
            each.scenario,
            each.sensor,
            each.figure,
            f"{each.published_degC:.2f}",
            f"{each.simulated_degC:.2f}",
            f"{each.difference_degC:+.2f}",
            "yes" if each.within else "NO",
        )
        for each in found
    )
    missed = sum(not each.within for each in found)
    caption = (
        f"degC. Within the bar ({MEAN_BAR_DEGC:g} degC for a mean, {STD_BAR_FRAC:.0%} for a standard deviation): "
        f"{len(found) - missed} of {len(found)}."
    )
    return Table(caption, ("scenario", "sensor", "figure", "published", "simulated", "difference", "within"), rows)
