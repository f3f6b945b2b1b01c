"""The report of a calibration: each probe's offset at each temperature."""

from __future__ import annotations

from collections.abc import Mapping

from ambient_trainer.laboratory.probe_offsets import ProbeOffset
from ambient_trainer.report import Block, Finding, Report, Table


def report_of(
    offsets: Mapping[str, ProbeOffset], path: str, reference: str, errors_K: Mapping[str, float] | None = None
) -> Report:
    """The offsets in the file at ``path``; ``errors_K`` is what the probes read too much, where that is known."""
    points = [(name, point) for name, offset in offsets.items() for point in offset.points]
    rows = [
        (name, f"{point.reading_degC:.2f}", f"{point.offset_K:+.4f}", f"{point.standard_error_K:.4f}")
        for name, point in points
    ]
    note = f"Offsets in K, added to what a probe reads. Reference: {reference}; its own error is not in them."
    blocks: list[Block] = [Table("", ("probe", "reads degC", "offset", "standard error"), rows), Finding(note)]
    if errors_K is not None:
        worst_K = max(abs(point.offset_K + errors_K[name]) for name, point in points)
        text = f"The simulated probes' errors are known: the worst offset misses its by {worst_K:.4f} K."
        blocks.append(Finding(text))
    return Report(f"Offsets: {path}", blocks, [], {}, "Calibration")
