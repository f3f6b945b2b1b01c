"""``at.diagnose``: what a circuit lacks or what changed on a device, and its result."""

import os
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import Any

import pandas as pd
from joblib import parallel_config

from ambient_trainer.api.data import Data, traces_of
from ambient_trainer.api.result import Result
from ambient_trainer.circuits.circuit import Circuit
from ambient_trainer.circuits.write import save_circuit
from ambient_trainer.data.spikes import without_spikes
from ambient_trainer.diagnosis.diagnose import diagnose as diagnose_traces
from ambient_trainer.diagnosis.later import Later, later_errors, require_later
from ambient_trainer.diagnosis.report import report_of
from ambient_trainer.diagnosis.result import Diagnosis
from ambient_trainer.estimators.registry import thermal_circuit
from ambient_trainer.report import Finding, Report


@dataclass(frozen=True, repr=False)
class DiagnosisResult(Result):
    """What the traces hold that the circuit does not describe.

    Attributes
    ----------
    diagnosis : Diagnosis
        Steps, ranking, residuals and their tests.
    later : Later or None
        Errors on time that the diagnosis has not seen, where that was asked for.
    """

    diagnosis: Diagnosis
    later: Later | None = None

    @property
    def verdict(self) -> dict[str, Any]:
        """The first step: cause, location, signal, times, magnitude, confidence and gain."""
        return dict(self.summary.data["verdict"])

    @cached_property
    def steps(self) -> pd.DataFrame:
        """One row a cause that was added, the largest first; nested values have dotted names, as ``gain.p_value``."""
        return pd.json_normalize(list(self.summary.data["steps"]))

    @cached_property
    def ranking(self) -> pd.DataFrame:
        """One row a candidate of the first step, the best first."""
        return pd.json_normalize(list(self.summary.data["ranking"]))

    @property
    def extended(self) -> Circuit | None:
        """The circuit with what was found, where a circuit can hold it."""
        return self.diagnosis.extended

    @cached_property
    def summary(self) -> Report:
        """What ``ambient-trainer diagnose`` shows."""
        report, later = report_of(self.diagnosis), self.later
        if later is None:
            return report
        what = (
            f"On {later.samples:,} samples from {later.from_s:.10g} s on, which no step has seen, the circuit is "
            f"{later.bare_rmse_degC:.2f} degC off, with what was found {later.extended_rmse_degC:.2f} degC (RMSE)."
        )
        if later.extended_rmse_degC > later.bare_rmse_degC:
            what += " It is worse there: what was found does not hold."
        first, *rest = report.lead
        return replace(report, lead=[first, Finding(what), *rest], data={**report.data, "later": asdict(later)})

    def save_circuit(self, path: str | os.PathLike[str]) -> str:
        """Write the extended circuit.

        Parameters
        ----------
        path : str or path
            A YAML file.

        Returns
        -------
        str
            The same path.

        Raises
        ------
        ValueError
            Where nothing was found that a circuit can hold.
        """
        if self.extended is None:
            raise ValueError("nothing was found that a circuit can hold")
        save_circuit(os.fspath(path), self.extended)
        return os.fspath(path)


def diagnose(
    data: Data,
    circuit: str,
    *,
    baselines: Data = (),
    from_s: float | None = None,
    to_s: float | None = None,
    later_from_s: float | None = None,
    period_s: float | None = None,
    jobs: int | None = None,
    progress: Callable[[str, int, int], None] | None = None,
) -> DiagnosisResult:
    """Name what traces hold that a circuit does not describe, and measure what adding it gains.

    Parameters
    ----------
    data : DataFrame, path, or several of them
        The traces to diagnose.
    circuit : str
        A shipped circuit or a YAML file; it is simulated forward, from ambient and drives to every sensor.
    baselines : DataFrame, path, or several of them
        Known-good traces of the same device. With them the question is what changed since, without what the circuit
        lacks.
    from_s, to_s : float, optional
        Only samples with ``from_s <= time_s < to_s`` are diagnosed.
    later_from_s : float, optional
        Samples from then on are kept from the diagnosis, and score the circuit without and with what was found.
    period_s : float, optional
        The grid on which readings are compared; by default of at most 2000 samples.
    jobs : int, optional
        Processes for the candidates; by default joblib's setting.
    progress : callable, optional
        Called with what is being done, how much of it is done, and how much there is.

    Returns
    -------
    DiagnosisResult
        The verdict, its steps and the ranking of candidates.

    Raises
    ------
    Refused
        Where the traces are too short, lack a column, or nothing in them changes.

    Notes
    -----
    Each step adds the candidate that leaves the least error on blocks of time that were held out, with a penalty for
    what it assumes; with ``baselines`` in units of each sensor's noise, beside a circuit that these hold. Before that,
    isolated error codes and wild readings give way to the median around them, and a note says how many.

    Examples
    --------
    >>> import ambient_trainer as at
    >>> hidden = at.simulate("4", seed=1, period_s=20.0, hide=["heat_source:board2:1.5W:from=2h:to=3h"])
    >>> found = at.diagnose(hidden.trace, "phone", baselines=at.simulate("4", period_s=20.0).trace)  # takes a minute
    >>> found.verdict["cause"], found.verdict["location"]
    ('heat_source', 'board2')
    """
    traces = [trace.cut(from_s, to_s) for trace in traces_of(data)]
    seen = traces
    if later_from_s is not None:
        require_later(traces, later_from_s)
        seen = [trace.cut(None, later_from_s) for trace in traces]
    clean = [without_spikes(trace) for trace in seen]
    known = [without_spikes(trace) for trace in traces_of(baselines)]
    own, good = ([trace for trace, _ in each] for each in (clean, known))
    with parallel_config(n_jobs=jobs):
        found = diagnose_traces(thermal_circuit(circuit), own, good, progress, period_s)
    for trace, spikes in (*clean, *known):
        if spikes:
            counts = ", ".join(f"{count} of {name}" for name, count in spikes.items())
            note = f"{trace.path}: readings that jump away and return at once were set aside: {counts}."
            found = replace(found, notes=(*found.notes, note))
    if later_from_s is None or found.fitted is None:
        return DiagnosisResult(found)
    scored = [without_spikes(trace)[0] for trace in traces]
    return DiagnosisResult(found, later_errors(found.fitted, found.extended, scored, later_from_s))
