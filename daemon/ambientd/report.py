"""The report of one tick, and its JSON object."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

from ambient_model.model import Input
from ambient_model.tracking import Estimate
from ambientd.json_text import json_text, quoted

if TYPE_CHECKING:
    from ambientd.reference import OffsetReport


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
    offset: "OffsetReport | None" = None
    """The unit's, where it is learnt."""


class _Form:
    """The text of a report that is the same at every tick, with ``%s`` where its values go."""

    inputs: tuple[Input, ...] | None = None
    model = text = text_of_sensors = line = ""
    report: Report | None = None
    """What ``line`` is the text of: several outputs ask for it."""
    raw: Sequence[float | None] = ()
    used: Sequence[float | None] = ()
    sensors = ""
    """The text of these two, which mostly are those of the tick before."""

    def fit(self, model: str, inputs: tuple[Input, ...]) -> None:
        def literal(text: str) -> str:
            return quoted(text).replace("%", "%%")

        sensors = [f'{literal(each.name)}: {{"unit": {literal(each.unit)}, "raw": %s, "used": %s}}' for each in inputs]
        self.model, self.inputs, self.raw, self.used = model, inputs, (), ()
        self.text_of_sensors = ", ".join(sensors)
        self.text = (
            f'{{"time_s": %s, "model": {literal(model)}, "status": "%s", "ambient_degC": %s, "low_degC": %s,'
            ' "high_degC": %s, "level_percent": %s, "age_s": %s, "missed_ticks": %s, "clock_steps_back": %s,'
            ' "sensors": {%s}}'
        )


_FORM = _Form()


def as_json(report: Report) -> str:
    """``report`` as one JSON object on one line, without the newline; what is not known is null."""
    if report is _FORM.report:
        return _FORM.line
    model, inputs, level_percent, time_s, raw, estimate, age_s, missed_ticks, steps_back, offset = report
    if inputs is not _FORM.inputs or model != _FORM.model:
        _FORM.fit(model, inputs)
    ambient, low, high, status, used = estimate
    if raw is not _FORM.raw or used != _FORM.used:
        _FORM.raw, _FORM.used = raw, used
        read = _shown(raw)
        pairs = zip(read, read if used == tuple(raw) else _shown(used))  # to write a number takes longest
        _FORM.sensors = _FORM.text_of_sensors % tuple([text for pair in pairs for text in pair])
    values = time_s, status, ambient, low, high, level_percent, age_s, missed_ticks, steps_back, _FORM.sensors
    line = _FORM.text % (values if None not in values else _shown(values))
    _FORM.report, _FORM.line = report, line if offset is None else f"{line[:-1]}, {_offset_text(offset)}}}"
    return _FORM.line


def _shown(values: Sequence[object]) -> tuple[object, ...]:
    return tuple(["null" if value is None else str(value) for value in values])


class _OffsetText:
    """The text of the offset, which changes once a second."""

    of: "OffsetReport | None" = None
    text = ""


def _offset_text(offset: "OffsetReport") -> str:
    if offset is not _OffsetText.of:
        offset_degC, std_degC, last = offset
        reference = json_text(last and last._asdict())
        _OffsetText.of = offset
        _OffsetText.text = (
            f'"offset_degC": {offset_degC!r}, "offset_std_degC": {std_degC!r}, "last_reference": {reference}'
        )
    return _OffsetText.text
