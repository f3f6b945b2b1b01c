"""Outliers: the units that fit the population least, and the likely cause of each."""

from collections.abc import Sequence

import numpy as np
import pandas as pd
from joblib import parallel_config

from ambient_model.faults import Refused
from ambient_trainer.data.spikes import without_spikes
from ambient_trainer.estimators.registry import thermal_circuit
from ambient_trainer.fleet.causes import Outlier, Typical, learn, name_cause
from ambient_trainer.fleet.dataset import Entry, Log, Source, logs, reason_of
from ambient_trainer.fleet.fit_units import OK
from ambient_trainer.fleet.pooling import improbability

_LISTED = 15
_TYPICAL = 40
"""As many as a circuit has numbers: their scatter is the prior of a unit that differs."""
_DIAGNOSED_FROM = 4.0
"""Six of a thousand simulated units are as improbable without a planted cause."""


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
    good = table[table["improbability"] < _DIAGNOSED_FROM]
    apart = (good["improbability"] - good["improbability"].median()).abs()
    return good["unit"].iloc[np.lexsort((good["unit"], apart))[:_TYPICAL]].tolist()


def learn_typical(wanted: Sequence[Sequence[Entry]], source: Source, circuit: str) -> list[Typical | str]:
    """A forward circuit as the one set of typical units has it, or why it cannot be learnt."""
    (units,) = wanted
    good = [without_spikes(log.trace)[0] for log in logs(units, source) if log.trace is not None]
    try:
        return [learn(thermal_circuit(circuit), good)]
    except Refused as refused:
        return [reason_of(refused)]


def diagnose_units(wanted: Sequence[Entry], source: Source, typical: Typical | str) -> list[Outlier]:
    """What is odd about each of some units, beside what was learnt of typical ones."""
    return [_named(log, typical) for log in logs(wanted, source)]


def _named(log: Log, typical: Typical | str) -> Outlier:
    if isinstance(typical, str) or log.trace is None:
        return undiagnosed(log, log.reason or str(typical))
    try:
        with parallel_config(n_jobs=1):
            return name_cause(typical, without_spikes(log.trace)[0], log.unit)
    except Refused as refused:
        return undiagnosed(log, reason_of(refused))


def undiagnosed(of: Entry | Log, reason: str) -> Outlier:
    """One without a verdict."""
    return Outlier(of.unit, cause=f"not diagnosed: {reason}")
