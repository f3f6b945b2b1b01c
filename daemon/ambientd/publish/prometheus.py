"""A node_exporter textfile: gauges with HELP and TYPE and no timestamps, for which it would skip the whole file.

A gauge without a value is left out.
"""

from collections.abc import Iterable
from typing import TYPE_CHECKING

from ambient_model.tracking import COASTING, DEGRADED, FAULTED, TRACKING, WARMING_UP
from ambientd.publish.file import RenamedFile
from ambientd.publish.spec import Spec
from ambientd.report import Report

if TYPE_CHECKING:
    from ambientd.reference import OffsetReport

_STATUSES = (WARMING_UP, TRACKING, DEGRADED, COASTING, FAULTED)


def publisher(spec: Spec, patience_ms: int | None) -> RenamedFile:
    """A ``*.prom`` file, replaced by rename; removed at the end, as its gauges would be scraped for ever."""
    return RenamedFile(spec, lambda report, spec: exposition(report).encode())


def exposition(report: Report) -> str:
    """``report`` in the text exposition format."""
    estimate = report.estimate
    model = _labels(model=report.model)
    sensors = [
        (_labels(sensor=each.name, unit=each.unit), raw, used)
        for each, raw, used in zip(report.inputs, report.raw, estimate.used)
    ]
    return "".join(
        [
            _gauge("ambient_celsius", "Estimated ambient temperature.", [(model, estimate.ambient_degC)]),
            _gauge("ambient_low_celsius", "Lower end of the interval.", [(model, estimate.low_degC)]),
            _gauge("ambient_high_celsius", "Upper end of the interval.", [(model, estimate.high_degC)]),
            _gauge("interval_ratio", "Share of errors that the interval covers.", [("", report.level_percent / 100)]),
            _gauge(
                "estimate_age_seconds",
                "Time since the estimate last used current readings alone.",
                [("", report.age_s)],
            ),
            _gauge("missed_ticks", "Ticks that could not be held.", [("", report.missed_ticks)]),
            _gauge("clock_steps_back", "How often the clock went back.", [("", report.clock_steps_back)]),
            _gauge(
                "status",
                "1 for the status that holds.",
                [(_labels(status=status), float(status == estimate.status)) for status in _STATUSES],
            ),
            _gauge("sensor_raw", "Sensor value as read.", [(labels, raw) for labels, raw, _ in sensors]),
            _gauge(
                "sensor_used", "Sensor value as used by the estimate.", [(labels, used) for labels, _, used in sensors]
            ),
            *(() if report.offset is None else _offset_gauges(report.offset)),
        ]
    )


def _offset_gauges(offset: "OffsetReport") -> Iterable[str]:
    yield _gauge("offset_celsius", "The unit's learnt offset, in the estimate.", [("", offset.offset_degC)])
    yield _gauge("offset_std_celsius", "Standard deviation of that offset.", [("", offset.std_degC)])
    if offset.last is not None:
        yield _gauge("last_reference_counted", "1 where the last reading counted.", [("", float(offset.last.counted))])


def _gauge(name: str, explanation: str, samples: Iterable[tuple[str, float | None]]) -> str:
    lines = [f"ambientd_{name}{labels} {value!r}\n" for labels, value in samples if value is not None]
    if not lines:
        return ""
    return f"# HELP ambientd_{name} {explanation}\n# TYPE ambientd_{name} gauge\n{''.join(lines)}"


def _labels(**labels: str) -> str:
    return "{" + ",".join(f'{name}="{_escaped(value)}"' for name, value in labels.items()) + "}"


def _escaped(value: str) -> str:
    return value.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")
