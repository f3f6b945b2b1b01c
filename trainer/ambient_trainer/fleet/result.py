"""The table of a fleet: a row a unit, failures too; and what a run leaves to be shown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import pandas as pd

from ambient_trainer.fleet.pooling import Population

if TYPE_CHECKING:
    from ambient_trainer.fleet.fit_units import Start

NUMBERS = (
    "samples",
    "duration_s",
    "effective_samples",
    "shrinkage",
    "kept",
    "rmse_pooled_degC",
    "rmse_separate_degC",
    "rmse_partial_degC",
    "half_width_90_degC",
    "distance",
    "freedom",
    "leverage",
    "misfit_degC2",
)


class Outlier(NamedTuple):
    """A unit that does not fit the population: minus the decimal logarithm of how probable it is, and the cause."""

    unit: str
    improbability: float
    cause: str | None = None
    location: str | None = None


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


def table_of(rows: Sequence[Mapping[str, Any]], within: Sequence[str], parameters: Sequence[str]) -> pd.DataFrame:
    """The rows as a table, whose columns and their types do not depend on who failed."""
    numbers = [*NUMBERS, *(f"{name}{end}" for name in parameters for end in ("", "_low90", "_high90"))]
    columns = {
        name: pd.Series([row.get(name) for row in rows], dtype="object")
        for name in ("unit", *within, "status", "reason")
    }
    return pd.DataFrame(
        columns | {name: pd.Series([row.get(name) for row in rows], dtype="float64") for name in numbers}
    )


def save_table(path: str, table: pd.DataFrame) -> None:
    """Write the table as Parquet, whole or not at all; the same table gives the same bytes."""
    import os

    import pyarrow as pa
    import pyarrow.parquet as pq

    temporary = f"{path}.{os.getpid()}.part"
    pq.write_table(pa.Table.from_pandas(table, preserve_index=False), temporary)
    os.replace(temporary, path)
