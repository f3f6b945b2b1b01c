"""The result of a fleet's run: a table with a row a unit, failures too, and what it was fitted under."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

import pandas as pd

from ambient_trainer.fleet.pooling import Population

if TYPE_CHECKING:
    from ambient_trainer.fleet.fit_units import Start


class Outlier(NamedTuple):
    """A unit that does not fit the population: minus the decimal logarithm of how probable it is, and the cause.

    ``confidence`` is the probability that a diagnosis gives its cause; ``rivals`` are those that explain its
    data as well.
    """

    unit: str
    improbability: float
    cause: str | None = None
    location: str | None = None
    confidence: float | None = None
    rivals: str | None = None


@dataclass(frozen=True)
class FleetFit:
    """A fitted fleet.

    ``table`` has a row a unit in the order of their names; ``outliers`` are the units that fit the population least,
    the least probable first.
    """

    circuit: str
    folder: str
    table: pd.DataFrame = field(repr=False)
    population: Population = field(repr=False)
    start: Start = field(repr=False)
    groups: tuple[tuple[str, ...], ...]
    outliers: tuple[Outlier, ...]

    @property
    def failed(self) -> pd.DataFrame:
        """The units that could not be fitted, with the reason."""
        return self.table[self.table["status"] == "failed"]
