"""The report of one tick, and its JSON object."""

from collections.abc import Sequence
from typing import NamedTuple

from ambient_model.model import Input
from ambient_model.tracking import Estimate


class Report(NamedTuple):
    """One tick."""

    model: str
    inputs: tuple[Input, ...]
    level_percent: int
    time_s: float
    """On the clock that counts from boot; in a replay, the trace's."""
    raw: Sequence[float | None]
    """Each input as it was read."""
    estimate: Estimate
    age_s: float | None
    """Since the estimate last used current readings alone; None where it never did."""
    missed_ticks: int = 0
    """Since the start or the last reload."""
    clock_steps_back: int = 0


class _Form:
    """The text of a report that is the same at every tick, with ``%s`` where its values go."""

    inputs: tuple[Input, ...] | None = None
    model = text = ""

    def fit(self, model: str, inputs: tuple[Input, ...]) -> None:
        import json  # a daemon that publishes files alone does without

        def quoted(text: str) -> str:
            return json.dumps(text).replace("%", "%%")

        sensors = [f'{quoted(each.name)}: {{"unit": {quoted(each.unit)}, "raw": %s, "used": %s}}' for each in inputs]
        self.model, self.inputs = model, inputs
        self.text = (
            f'{{"time_s": %s, "model": {quoted(model)}, "status": "%s", "ambient_degC": %s, "low_degC": %s,'
            ' "high_degC": %s, "level_percent": %s, "age_s": %s, "missed_ticks": %s, "clock_steps_back": %s,'
            f' "sensors": {{{", ".join(sensors)}}}}}'
        )


_FORM = _Form()


def as_json(report: Report) -> str:
    """``report`` as one JSON object on one line, without the newline; what is not known is null."""
    model, inputs, level_percent, time_s, raw, estimate, age_s, missed_ticks, steps_back = report
    if inputs is not _FORM.inputs or model != _FORM.model:
        _FORM.fit(model, inputs)
    ambient, low, high, status, used = estimate
    values = [time_s, status, ambient, low, high, level_percent, age_s, missed_ticks, steps_back]
    for pair in zip(raw, used):
        values += pair
    return _FORM.text % tuple(["null" if value is None else value for value in values])
