"""``at.fit``: an estimator fitted to traces, and its result."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import pandas as pd

from ambient_model.codec import save_model
from ambient_model.model import Model, ReadingModel
from ambient_model.trace import split_column
from ambient_trainer.api.data import Data, sensor_columns, traces_of
from ambient_trainer.api.result import Result
from ambient_trainer.data.resolution import with_resolution
from ambient_trainer.estimation.search import Progress
from ambient_trainer.estimators.base import Effort, Fit, temperature_columns
from ambient_trainer.estimators.model_file import model_of, require_zones, training_of
from ambient_trainer.estimators.readings import reading_model
from ambient_trainer.estimators.registry import estimator
from ambient_trainer.estimators.report import report_of
from ambient_trainer.report import Report


@dataclass(frozen=True, repr=False)
class FitResult(Result):
    """A fitted estimator.

    Attributes
    ----------
    fitted : Fit
        The continuous system with all that is known of it.
    training : tuple of mapping
        The provenance of each training trace: file, SHA-256, window.
    zones : mapping of str to str
        Thermal zone types by input name, where they differ.
    readings : ReadingModel or None
        What a device expects of its sensors; None where the traces are too short.
    """

    fitted: Fit
    training: tuple[Mapping[str, Any], ...]
    zones: Mapping[str, str] = field(default_factory=dict)
    readings: ReadingModel | None = None

    @property
    def circuit(self) -> str:
        """The estimator's name."""
        return self.fitted.circuit

    @property
    def rmse_degC(self) -> float:
        """Root mean square error on the training samples."""
        return self.fitted.rmse_degC

    @property
    def identifiable(self) -> bool:
        """Whether the training data determine every free parameter."""
        return self.fitted.identifiable

    @cached_property
    def model(self) -> Model:
        """The model that a device runs; raises :class:`Refused` where the circuit does not estimate the ambient."""
        return model_of(self.fitted, self.training, self.zones, self.readings)

    @cached_property
    def parameters(self) -> pd.DataFrame:
        """Parameters by name: value, unit, standard error, ends of the 95 % interval, and whether they are free,
        at a bound, identifiable.
        """
        rows = [
            {**each._asdict(), "low95": (each.interval95 or (None,))[0], "high95": (each.interval95 or (None,))[-1]}
            for each in self.fitted.parameters
        ]
        columns = ["value", "unit", "standard_error", "low95", "high95", "free", "at_bound", "identifiable"]
        frame = pd.DataFrame(rows, columns=["name", *columns]).set_index("name")
        return frame.astype(dict.fromkeys(["value", "standard_error", "low95", "high95"], float))

    @cached_property
    def inputs(self) -> pd.DataFrame:
        """Inputs by trace column: DC gain, least and largest training value, RMSE of the fallback without it."""
        low, high = zip(*self.fitted.input_ranges)
        without = [self.fitted.fallbacks.get(name.rpartition("_")[0]) for name in self.fitted.inputs]
        columns = {
            "dc_gain": self.fitted.dc_gains,
            "low": low,
            "high": high,
            "rmse_without_degC": [None if each is None else each.rmse_degC for each in without],
        }
        return pd.DataFrame(columns, index=pd.Index(self.fitted.inputs, name="input"), dtype=float)

    @cached_property
    def errors(self) -> pd.DataFrame:
        """Training errors in degC (true minus predicted), one column an output."""
        return pd.DataFrame({n: pd.Series(e) for n, e in zip(self.fitted.outputs, self.fitted.errors_degC)})

    @property
    def summary(self) -> Report:
        """What ``ambient-trainer fit`` shows."""
        return report_of(self.fitted)

    def _write(self, path: str) -> None:
        save_model(path, self.model)


def fit(
    data: Data,
    circuit: str,
    *,
    sensors: Sequence[str] | None = None,
    from_s: float | None = None,
    to_s: float | None = None,
    period_s: float | None = None,
    zones: Mapping[str, str] | None = None,
    resolution: Mapping[str, float] | None = None,
    effort: Effort | None = None,
    progress: Progress | None = None,
) -> FitResult:
    """Fit an estimator of the ambient to logged traces.

    Parameters
    ----------
    data : DataFrame, path, or several of them
        Traces with the sensors and the reference ``ambient_degC``.
    circuit : str
        A shipped circuit (``model2_ss``), an estimator (``free-1`` to ``free-4``, ``free_observer``,
        ``circuit_observer``, ``phone_observer``), or a YAML file of a circuit or a recipe.
    sensors : sequence of str, or str, optional
        What the estimators that read any sensors read; by default every temperature but the references.
    from_s, to_s : float, optional
        Only samples with ``from_s <= time_s < to_s`` are used.
    period_s : float, optional
        The grid; by default the traces' own.
    zones : mapping of str to str, optional
        The thermal zone's type by input name, where it is not the name.
    resolution : mapping of str to float, optional
        The device's steps in degC by sensor, where it reads coarser than the log: training reads the log in them.
    effort : Effort, optional
        Starts, seed, pieces and budget of the search.
    progress : callable, optional
        Called after each evaluation with the search's number, the evaluation's, and the best sum of squares so far.

    Returns
    -------
    FitResult
        Parameters with intervals, errors, the model file, and what the data determine.

    Raises
    ------
    Refused
        For an unknown name, a missing column, or traces that hold too little.

    Notes
    -----
    A circuit's temperatures follow :math:`\\dot x = A x + B u`, its estimate is :math:`y = C x + D u + d`. Matrices
    depend on resistances, capacitances and weights; those that enter linearly are solved for exactly inside the search
    (variable projection: Golub and Pereyra, SIAM J. Numer. Anal. 10(2), 1973). Standard errors are of the sandwich
    form with batched scores (White, Econometrica 50(1), 1982), as residuals are not white.

    Examples
    --------
    >>> import ambient_trainer as at
    >>> log = at.simulate("3", period_s=10.0).trace
    >>> result = at.fit(log, "free-1", sensors=["usb", "battery"], effort=at.Effort(starts=1))
    >>> list(result.inputs.index)
    ['usb_degC', 'battery_degC']
    >>> result.save("model.json")
    'model.json'
    """
    columns = sensor_columns(sensors)
    method = estimator(circuit, columns)
    steps = dict(zip(sensor_columns(list(resolution or {})), (resolution or {}).values()))
    traces = [with_resolution(trace.cut(from_s, to_s), steps) for trace in traces_of(data)]
    if zones:  # a name that is no input's is refused before the search
        read = method.own_columns or columns or temperature_columns(traces)
        require_zones(zones, [split_column(column)[0] for column in read])
    fitted = method.fit(traces, effort or Effort(), progress, period_s, columns or None)
    training = [{**training_of(trace, from_s, to_s), **({"resolution": steps} if steps else {})} for trace in traces]
    return FitResult(fitted, tuple(training), zones or {}, reading_model(fitted, traces))
