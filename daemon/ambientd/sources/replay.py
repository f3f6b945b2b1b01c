"""A trace as a source: the columns that a model reads, between two times, in the trace's own time."""

import itertools
from collections.abc import Iterator
from types import TracebackType

from ambient_model.faults import Fault, Refused, refuse
from ambient_model.model import Input, Model
from ambient_model.trace import TraceReader
from ambientd.fallback import FallbackTracker

_LEARN_ROWS = 200
_MOST_SHOWN = 100

Sample = tuple[float, list[float | None]]


class TraceSource:
    """The samples of a trace, one value per input; read once, in constant memory.

    ``period_s`` is how far apart they lie, None where there is but one. Raises :class:`Refused` for a column that is
    not there and where no sample lies in from_s <= time_s < to_s.
    """

    def __init__(
        self, path: str, inputs: tuple[Input, ...], from_s: float | None = None, to_s: float | None = None
    ) -> None:
        self.path = path
        self._reader = TraceReader(path)
        try:
            self._rows = self._cut(self._picked(self._indices(inputs)), from_s, to_s)
            self._first = list(itertools.islice(self._rows, _LEARN_ROWS))
            if not self._first:
                raise self._nothing(from_s, to_s)
        except BaseException:
            self._reader.__exit__()
            raise
        self.period_s = _period_s([time_s for time_s, _ in self._first])

    def __enter__(self) -> "TraceSource":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._reader.__exit__()

    def __iter__(self) -> Iterator[Sample]:
        return itertools.chain(self._first, self._rows)

    def _indices(self, inputs: tuple[Input, ...]) -> list[int]:
        columns = self._reader.header.columns
        some = ", ".join([*columns[:_MOST_SHOWN], *["..."] * (len(columns) > _MOST_SHOWN)])
        faults = [
            Fault(
                "header",
                f"no column '{each.column}', which the model reads",
                f"it has {some or 'none'}; log it or map it on import",
            )
            for each in inputs
            if each.column not in columns
        ]
        if faults:
            raise Refused(self.path, faults)
        return [columns.index(each.column) for each in inputs]

    def _picked(self, indices: list[int]) -> Iterator[Sample]:
        for time_s, values in self._reader:
            yield time_s, [values[index] for index in indices]

    def _cut(self, rows: Iterator[Sample], from_s: float | None, to_s: float | None) -> Iterator[Sample]:
        if from_s is not None:
            rows = itertools.dropwhile(lambda row: row[0] < from_s, rows)
        return rows if to_s is None else itertools.takewhile(lambda row: row[0] < to_s, rows)

    def _nothing(self, from_s: float | None, to_s: float | None) -> Refused:
        if from_s is None and to_s is None:
            return refuse(self.path, "", "no samples under the header", "log something first")
        return refuse(self.path, "", "nothing lies between --from and --to", "choose others")


def _period_s(times_s: list[float]) -> float | None:
    """The mean of the steps that lie within 50 % of their median: neither gaps nor jitter move it."""
    steps = sorted(after - before for before, after in itertools.pairwise(times_s))
    if not steps:
        return None
    median = steps[len(steps) // 2]
    usual = [step for step in steps if abs(step - median) <= 0.5 * median]
    return sum(usual) / len(usual)


def tracker_for(model: Model, source: TraceSource, level: int = 90, coast_s: float | None = None) -> FallbackTracker:
    """The model at the period of the trace; raises :class:`Refused` where every step of the trace is a gap to it."""
    period_s = source.period_s or min(each.period_s for each in model.main.discrete)
    tracker = FallbackTracker(model, period_s, level, coast_s)
    if period_s > tracker.limit_s:
        raise refuse(
            source.path,
            "",
            f"its samples lie {period_s:g} s apart, and model '{model.name}' at {tracker.period_s:g} s bridges at most"
            f" {tracker.limit_s:g} s",
            "log more often, or fit the model to a trace with this period",
        )
    return tracker
