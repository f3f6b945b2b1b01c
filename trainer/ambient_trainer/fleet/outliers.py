"""What is odd about the units that fit the population least: each is diagnosed, typical ones being known as good."""

from collections.abc import Sequence

import numpy as np
import pandas as pd
from joblib import parallel_config
from threadpoolctl import threadpool_limits

from ambient_model.faults import Refused
from ambient_trainer.data.spikes import without_spikes
from ambient_trainer.data.trace import Trace
from ambient_trainer.diagnosis.diagnose import diagnose
from ambient_trainer.diagnosis.report import report_of
from ambient_trainer.estimators.registry import thermal_circuit
from ambient_trainer.fleet.dataset import Entry, Source, logs
from ambient_trainer.fleet.fit_units import OK
from ambient_trainer.fleet.pooling import improbability
from ambient_trainer.fleet.result import Outlier

_LISTED = 15
_KNOWN_GOOD = 4
"""Typical units train the forward circuit: what they leave of each other counts as the sensors' noise."""
_DIAGNOSED_FROM = 4.0
"""Six of a thousand simulated units are as improbable without a planted cause; a diagnosis takes a minute or two."""


def scored(table: pd.DataFrame) -> pd.DataFrame:
    """A fleet's table with the improbability of each unit, missing for those that failed.

    By its distance, by how its sensors go together, and by what it leaves with its own gains and the population's.
    """
    good = table["status"] == OK
    columns = table.loc[good, ["distance", "leverage", "misfit_degC2", "rmse_pooled_degC"]].to_numpy(dtype=float)
    found = pd.Series(improbability(*columns[:, :3].T, columns[:, 3] ** 2), index=table.index[good])
    return table.assign(improbability=found)


def least_probable(table: pd.DataFrame) -> tuple[Outlier, ...]:
    """The units of a fleet's table that fit its population least, the least probable first."""
    worst = table[table["improbability"].notna()].sort_values(["improbability", "unit"], ascending=[False, True])
    rows = worst.head(_LISTED)
    return tuple(Outlier(unit, float(value)) for unit, value in zip(rows["unit"], rows["improbability"]))


def to_diagnose(outliers: Sequence[Outlier]) -> list[str]:
    """The outliers that are worth a diagnosis."""
    return [each.unit for each in outliers if each.improbability >= _DIAGNOSED_FROM]


def typical(table: pd.DataFrame) -> list[str]:
    """The units in the middle of the population: neither odd nor oddly quiet."""
    good = table[table["improbability"].notna()]
    apart = (good["improbability"] - good["improbability"].median()).abs()
    return good["unit"].iloc[np.lexsort((good["unit"], apart))[:_KNOWN_GOOD]].tolist()


def diagnose_units(wanted: Sequence[Entry], source: Source, good: Sequence[Entry], circuit: str) -> list[Outlier]:
    """The cause and the location that a diagnosis with a forward circuit gives for each of some units."""
    with threadpool_limits(1), parallel_config(n_jobs=1):
        known = [_clean(log.trace) for log in logs(good, source) if log.trace is not None]
        return [_named(log.unit, log.trace, known, circuit) for log in logs(wanted, source)]


def _named(unit: str, trace: Trace | None, known: Sequence[Trace], circuit: str) -> Outlier:
    if trace is None:
        return Outlier(unit, np.nan)
    try:
        verdict = report_of(diagnose(thermal_circuit(circuit), [_clean(trace)], known)).data["verdict"]
    except Refused as refused:
        return Outlier(unit, np.nan, f"not diagnosed: {refused.faults[0].problem}")
    place = verdict.get("location")
    return Outlier(unit, np.nan, verdict["cause"], ", ".join(place) if isinstance(place, list) else place)


def _clean(trace: Trace) -> Trace:
    return without_spikes(trace)[0]
