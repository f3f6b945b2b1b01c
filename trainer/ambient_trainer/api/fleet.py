"""``at.fit_fleet``: an estimator for each of many units, and its result."""

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import pandas as pd

from ambient_model.codec import load_model
from ambient_model.faults import refuse
from ambient_model.model import Model
from ambient_trainer.api.data import sensor_columns
from ambient_trainer.api.result import Result
from ambient_trainer.estimators.base import Effort
from ambient_trainer.fleet.dataset import Source
from ambient_trainer.fleet.engine import engine_of
from ambient_trainer.fleet.fit_units import Question
from ambient_trainer.fleet.report import report_of
from ambient_trainer.fleet.run import FleetFit
from ambient_trainer.fleet.run import fit_fleet as fit_every_unit
from ambient_trainer.report import Report

_LOGS, _ROWS = "logs.parquet", 100_000


@dataclass(frozen=True, repr=False)
class FleetResult(Result):
    """A fitted fleet.

    Attributes
    ----------
    fitted : FleetFit
        The table, the population, and the units that do not fit it.
    """

    fitted: FleetFit

    @property
    def units(self) -> pd.DataFrame:
        """A row a unit, indexed by its name: what ``fleet.parquet`` holds."""
        return self.fitted.table.set_index("unit")

    @property
    def failed(self) -> pd.DataFrame:
        """The units that could not be fitted, with the reason."""
        return self.fitted.failed.set_index("unit")[["reason"]]

    @property
    def outliers(self) -> pd.DataFrame:
        """The units that fit the population least, the least probable first."""
        return pd.DataFrame(self.fitted.outliers).set_index("unit")

    @property
    def population(self) -> Model:
        """The model for a unit that was never seen."""
        return load_model(os.path.join(self.fitted.folder, "population.json"))

    @property
    def summary(self) -> Report:
        """What ``ambient-trainer fleet`` shows."""
        return report_of(self.fitted)


def fit_fleet(
    logs: str | os.PathLike[str] | pd.DataFrame,
    circuit: str,
    folder: str | os.PathLike[str],
    *,
    by: str = "unit",
    within: Sequence[str] | None = None,
    sensors: Sequence[str] | None = None,
    engine: str = "local",
    jobs: int | None = None,
    resume: bool = False,
    diagnose: str | None = None,
    effort: Effort | None = None,
    progress: Callable[[str, int, int], None] | None = None,
    announce: Callable[[str], None] | None = None,
) -> FleetResult:
    """Fit an estimator to each of many units, partially pooled.

    Parameters
    ----------
    logs : path or DataFrame
        A folder of traces, one a unit; a Parquet dataset with a unit column; or a frame with one.
    circuit : str
        As for :func:`ambient_trainer.fit`; it has to estimate the ambient.
    folder : path
        Gets ``fleet.parquet``, ``models/UNIT.json`` and ``population.json``.
    by : str
        The column that holds the unit.
    within : sequence of str, optional
        Columns of groups of units, whose means are one level more.
    sensors : sequence of str, optional
        What estimators read that read any sensors; by default every temperature that most units have.
    engine : str
        ``local`` (a Dask cluster on this machine), ``serial`` (this process), or a scheduler's address.
    jobs : int, optional
        Processes of the local cluster; by default one a core.
    resume : bool
        Whether to go on where the same call was interrupted.
    diagnose : str, optional
        A circuit that is simulated forward (``phone``): with it the cause of each unit that fits least is named, beside
        typical ones.
    effort : Effort, optional
        Starts and seed of the search that begins the population.
    progress, announce : callable, optional
        Called with what is under way, how much of it is done, and of how much; and with Dask's dashboard's address.

    Returns
    -------
    FleetResult
        The table, the population, and the units that do not fit it.

    Raises
    ------
    Refused
        Where there are fewer than two units that can be read, or the estimator does not give the ambient.

    Notes
    -----
    With the poles of a first fit held, :math:`y_u = Z_u c_u + e` is linear in a unit's gains :math:`c_u`. Their prior
    :math:`N(\\mu, \\Sigma)` maximises the marginal likelihood of all units (empirical Bayes: Efron and Morris, J. Am.
    Stat. Assoc. 70, 1975), robustly weighed. A log of duration T counts as T / tau samples, tau the
    autocorrelation time of its errors.
    """
    place = os.fspath(folder)
    path = _written(logs, by, place) if isinstance(logs, pd.DataFrame) else os.fspath(logs)
    source = Source(by, tuple(within or ()))
    question = Question(path, circuit, source, sensor_columns(sensors), effort or Effort(), diagnose)
    running, silent = engine_of(engine, jobs or os.cpu_count() or 1), lambda *_: None
    return FleetResult(fit_every_unit(question, place, running, resume, progress or silent, announce or silent))


def _written(frame: pd.DataFrame, by: str, folder: str) -> str:
    """The frame as a dataset that workers can read, the rows of a unit together."""
    if by not in frame.columns:
        raise refuse("DataFrame", "", f"no column {by!r}", "name the column that holds the unit: by=...")
    os.makedirs(folder, exist_ok=True)
    path = os.path.join(folder, _LOGS)
    whole = frame.reset_index() if frame.index.name == "time_s" else frame
    named = whole.dropna(subset=[by]).sort_values(by, key=lambda unit: unit.astype(str), kind="stable")
    named.to_parquet(path, index=False, row_group_size=_ROWS)
    return path
