"""``at.evaluate``: a model's errors on traces, and their result."""

import math
import os
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from functools import cached_property

import pandas as pd

from ambient_model.codec import load_model
from ambient_model.model import Model
from ambient_trainer.api.data import Data, traces_of
from ambient_trainer.api.fitting import FitResult
from ambient_trainer.api.result import Result
from ambient_trainer.evaluation.evaluate import Evaluation, evaluate_cold, evaluate_run_in
from ambient_trainer.evaluation.report import report_of, trace_labels
from ambient_trainer.evaluation.stress import Stressed, section_of
from ambient_trainer.evaluation.stress import stress as stress_trace
from ambient_trainer.report import Report


@dataclass(frozen=True, repr=False)
class EvaluationResult(Result):
    """A model's errors on one or several traces.

    Attributes
    ----------
    model : Model
        What was evaluated.
    evaluations : tuple of Evaluation
        One a trace.
    stressed : tuple of Stressed
        Per condition of the readings the errors on the first trace, where that was asked for.
    """

    model: Model
    evaluations: tuple[Evaluation, ...]
    stressed: tuple[Stressed, ...] = ()

    @cached_property
    def metrics(self) -> pd.DataFrame:
        """Metrics in degC by trace and method (``model``, ``model, run in``, ``static linear``).

        ``coverage_50``, ``coverage_90`` and ``coverage_98`` are the shares of errors inside the model file's intervals,
        ``published_50`` and so on inside those that a device publishes, which widens them for readings it lacks.
        """
        rows = []
        for label, each in zip(trace_labels(self.evaluations), self.evaluations):
            shares = {f"coverage_{level}": share for level, share in each.coverage.items()}
            shares |= {f"published_{level}": share for level, share in each.published_coverage.items()}
            for method, metrics in each.by_method.items():
                rows.append({"trace": label, "method": method, **asdict(metrics)})
                if method == "model":
                    rows[-1] |= {**shares, "overlaps_training": each.overlaps_training}
        return pd.DataFrame(rows).drop(columns="interval_degC").set_index(["trace", "method"])

    @cached_property
    def estimates(self) -> pd.DataFrame:
        """Every sample: trace, ``time_s``, estimate, 90 % interval, reference and error in degC, and status."""
        columns = ("time_s", "estimate_degC", "low_degC", "high_degC", "reference_degC", "error_degC", "status")
        labels = trace_labels(self.evaluations)
        return pd.concat(
            {
                label: pd.DataFrame({name: getattr(each, name) for name in columns})
                for label, each in zip(labels, self.evaluations)
            },
            names=["trace", "sample"],
        )

    @property
    def summary(self) -> Report:
        """What ``ambient-trainer evaluate`` shows; raises :class:`Refused` where the provenance cannot be read."""
        report = report_of(self.model, self.evaluations)
        if not self.stressed:
            return report
        sections = [section_of(self.stressed), *report.sections]
        return replace(
            report, sections=sections, data={**report.data, "stress": [asdict(each) for each in self.stressed]}
        )


def evaluate(
    model: Model | FitResult | str | os.PathLike[str],
    data: Data,
    *,
    from_s: float | None = None,
    to_s: float | None = None,
    run_in: bool = False,
    stress: bool = False,
    progress: Callable[[str, int, int], None] | None = None,
) -> EvaluationResult:
    """Run a model over traces as a device does, and score its estimate against ``ambient_degC``.

    Parameters
    ----------
    model : FitResult, Model or path
        What to evaluate; a path is that of a model file.
    data : DataFrame, path, or several of them
        Traces with the model's inputs and the reference.
    from_s, to_s : float, optional
        Only samples with ``from_s <= time_s < to_s`` are scored.
    run_in : bool
        Whether the estimate runs from the trace's first sample on, as on a device that was on before, and not from a
        cold start at ``from_s``.
    stress : bool
        Whether to run the first trace also with readings that are missing, coarse or wrong.
    progress : callable, optional
        Called before each trace with its name, how many are done, and how many there are.

    Returns
    -------
    EvaluationResult
        Metrics a trace, and every sample's estimate, interval and error.

    Raises
    ------
    Refused
        For a model file with faults, a missing column, or fewer than two samples to score.

    Notes
    -----
    The error is :math:`e = T_{true} - T_{estimate}`. RMSE, MAE and MBE are its root mean square, mean magnitude and
    mean; an interval is :math:`\\bar e \\pm \\lambda s` with the normal quantile :math:`\\lambda` (the thesis, section
    3.4). The estimate starts from equilibrium with the first sensor sample and never sees the reference.

    Examples
    --------
    >>> import ambient_trainer as at
    >>> log = at.simulate("3", period_s=10.0).trace
    >>> scores = at.evaluate(at.fit(log, "linear_usb", to_s=3_000), log, from_s=3_000)
    >>> sorted(method for _, method in scores.metrics.index)
    ['model', 'model, run in', 'static linear']
    """
    if isinstance(model, FitResult):
        model = model.model
    elif not isinstance(model, Model):
        model = load_model(os.fspath(model))
    evaluated = evaluate_run_in if run_in else evaluate_cold
    traces, evaluations = traces_of(data), []
    for done, trace in enumerate(traces):
        if progress is not None:
            progress(trace.path, done, len(traces))
        evaluations.append(evaluated(model, trace, from_s, to_s))
    first, scored_s = traces[0].cut(None if run_in else from_s, to_s), -math.inf if from_s is None else from_s
    stressed = stress_trace(model, first, from_s=scored_s) if stress else ()
    return EvaluationResult(model, tuple(evaluations), stressed)
