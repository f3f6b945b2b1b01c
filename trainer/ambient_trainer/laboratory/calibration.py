"""A stirred bath with a reference thermometer and a multiplexer's probes, real or simulated, read until it has settled.

What a record of it gives is in :mod:`ambient_trainer.evaluation.bath`.
"""

import contextlib
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing
from dataclasses import dataclass, field
from typing import Any

import pandas as pd

from ambient_trainer.data.probe_offsets import ProbeOffset
from ambient_trainer.evaluation.bath import REFERENCE, Settled, last_window, save_bath, unsettled
from ambient_trainer.laboratory import instruments as kinds
from ambient_trainer.laboratory.instruments import Driver, instrument
from ambient_trainer.laboratory.messages import Clock, InstrumentError
from ambient_trainer.report import Block, Finding, Report, Table
from ambient_trainer.simulator.chamber import Chamber
from ambient_trainer.simulator.live import ChamberAir

BATHS_DEGC = (0.0, 20.0, 40.0, 60.0)
"""The temperatures to which the simulated bath goes, one after the other."""
SPEED = 100.0
_BATH = Chamber(heating_K_min=1e4, cooling_K_min=1e4, wobble_degC=0.0, settling_s=120.0, draught_degC=0.0)  # chosen


@dataclass(eq=False)
class Bath:
    """The reference and the probes in one bath, which ``go_to`` brings to its temperature 0, 1, 2 and so on.

    They are read every ``period_s``, and all readings are kept; a temperature has ``patience_s`` to settle in.
    ``errors_K`` is what the probes read too much, where that is known.
    """

    thermometer: Driver
    multiplexer: Driver
    probes: tuple[str, ...]
    clock: Clock
    go_to: Callable[[int], None]
    errors_K: Mapping[str, float] | None
    period_s: float
    patience_s: float
    _rows: dict[float, dict[str, float | None]] = field(default_factory=dict, init=False)

    def identify(self) -> str:
        """The reference by its number; raises :class:`InstrumentError` where either instrument does not answer."""
        self.multiplexer.read()
        return self.thermometer.identify()

    def record(self) -> pd.DataFrame:
        """What was read so far, from the first sample on."""
        columns = {kinds.THERMOMETER_COLUMN: REFERENCE, **{kinds.probe_column(name): name for name in self.probes}}
        table = pd.DataFrame.from_dict(self._rows, orient="index", columns=list(columns), dtype=float)
        return table.rename(columns=columns).set_axis(table.index - min(self._rows, default=0.0))

    def windows(
        self, count: int, settled: Settled, show: Callable[[str], None], record_path: str | None
    ) -> list[pd.DataFrame]:
        """The settled window of each of ``count`` temperatures; all readings go to ``record_path``, also of a failure.

        ``show`` gets a line at each sample; for errors see :meth:`until_settled`.
        """
        found: list[pd.DataFrame] = []
        try:
            for point in range(count):
                self.go_to(point)
                head = f"bath {point + 1} of {count}"
                found.append(self.until_settled(settled, lambda text, head=head: show(f"{head}, {text}")))  # type: ignore[misc]
        finally:
            if record_path is not None:
                save_bath(self.record(), record_path)
        return found

    def until_settled(self, settled: Settled, show: Callable[[str], None]) -> pd.DataFrame:
        """The window in which the bath is settled; ``show`` gets its temperature at each sample, and what it lacks.

        Raises :class:`~ambient_model.faults.Refused` where patience ends, and an instrument's
        :class:`InstrumentError` where it did not answer in a whole window.
        """
        first, began_s = len(self._rows), self.clock.now_s()
        due_s = answered_s = began_s
        while True:
            failure, at_s, values = None, self.clock.now_s(), dict[str, float | None]()
            for each in (self.thermometer, self.multiplexer):
                try:
                    values.update(each.read().values)
                except InstrumentError as error:  # a missing value
                    failure = error
            self._rows[at_s] = values
            window = last_window(self.record().iloc[first:], settled)
            reasons = unsettled(window, settled)
            lacking = "; ".join([str(failure), *reasons] if failure else reasons) or "settled"
            show(f"{window[REFERENCE].iloc[-1]:.2f} degC: {lacking}")
            if not reasons:
                return window
            now_s = self.clock.now_s()
            if failure is None:
                answered_s = now_s
            elif now_s - answered_s > settled.window_s:
                raise failure
            if now_s - began_s > self.patience_s:
                raise settled.refusal("the bath", reasons)
            due_s = max(due_s + self.period_s, self.clock.now_s())
            self.clock.sleep(due_s - self.clock.now_s())


@contextlib.contextmanager
def bath(
    thermometer: kinds.ThermometerSettings,
    multiplexer: kinds.MultiplexerSettings,
    period_s: float,
    patience_s: float,
    go_to: Callable[[int], None] | None = None,
    speed: float = SPEED,
    room_degC: float = 22.0,
) -> Iterator[Bath]:
    """Two instruments at their ports in a :class:`Bath`, closed in the end.

    Without ``go_to`` both are simulated, ``speed`` times as fast, and their bath goes to :data:`BATHS_DEGC`.
    """
    links: list[Any] = [thermometer, multiplexer]
    clock, errors_K = Clock(speed if go_to is None else 1.0), None
    with contextlib.ExitStack() as stack:

        def opened(what: str, *arguments: object) -> list[Any]:
            made = [getattr(instrument(link.kind), what) for link in links]
            return [stack.enter_context(closing(kind(link, *arguments))) for kind, link in zip(made, links)]

        if go_to is None:
            water = ChamberAir(clock.now_s(), room_degC, 0, _BATH)
            there = opened("Simulated", clock, water.at)
            links = [link.model_copy(update={"port": each.port}) for link, each in zip(links, there)]
            errors_K = there[1].errors_K
            go_to = lambda point: water.drive(clock.now_s(), BATHS_DEGC[point])  # noqa: E731
        reference, probes = opened("Driver", clock)
        yield Bath(reference, probes, tuple(multiplexer.probes), clock, go_to, errors_K, period_s, patience_s)


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
