"""A calibration run: reference and probes are read side by side until their bath has settled."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from ambient_trainer.laboratory.clock import Clock
from ambient_trainer.laboratory.instruments.calibration import Bath, Settled, not_settled, unsettled
from ambient_trainer.laboratory.instruments.multiplexer import Multiplexer
from ambient_trainer.laboratory.instruments.thermometer import Thermometer
from ambient_trainer.laboratory.line import LineError


class BathLab(NamedTuple):
    """The reference and the probes in one bath, and how the bath is brought to its next temperature."""

    thermometer: Thermometer
    multiplexer: Multiplexer
    probes: tuple[str, ...]
    clock: Clock
    go: Callable[[int], None]
    """Called with 0, 1, 2 and so on before the bath is watched."""
    errors_K: Mapping[str, float] | None = None
    """What the probes read too much, where that is known."""

    def identify(self) -> str:
        """The reference by its number; raises :class:`LineError` where either instrument does not answer."""
        self.multiplexer.configure()
        return self.thermometer.identify()


class Pace(NamedTuple):
    """How often they are read, and how long a bath may take."""

    period_s: float
    patience_s: float


class BathRun:
    """All that was read in one run, from its first sample on."""

    def __init__(self, lab: BathLab, pace: Pace) -> None:
        self._lab = lab
        self._clock = lab.clock
        self._pace = pace
        self._rows: list[list[float]] = []
        self._began_s = lab.clock.now_s()

    def record(self) -> Bath:
        """What was read so far."""
        table = np.array(self._rows, dtype=np.float64).reshape(-1, 2 + len(self._lab.probes))
        probes = {name: table[:, 2 + index] for index, name in enumerate(self._lab.probes)}
        return Bath(table[:, 0], table[:, 1], probes)

    def until_settled(self, settled: Settled, show: Callable[[Bath, list[str]], None]) -> Bath:
        """The window in which the bath is settled; ``show`` is told at each sample what it lacks.

        Raises :class:`~ambient_model.faults.Refused` where patience ends, and an instrument's LineError where
        it did not answer in a whole window.
        """
        first, began_s = len(self._rows), self._clock.now_s()
        due_s = heard_s = began_s
        while True:
            missed = self._sample()
            bath = self.record()
            window = bath.part(first, len(bath.time_s)).last(settled.window_s)
            reasons = unsettled(window, settled)
            show(window, [str(missed), *reasons] if missed else reasons)
            if not reasons:
                return window
            if missed is None:
                heard_s = self._clock.now_s()
            elif self._clock.now_s() - heard_s > settled.window_s:
                raise missed
            if self._clock.now_s() - began_s > self._pace.patience_s:
                raise not_settled("the bath", reasons, settled)
            due_s = max(due_s + self._pace.period_s, self._clock.now_s())
            self._clock.sleep(due_s - self._clock.now_s())

    def _sample(self) -> LineError | None:
        """Read both; a failure is a missing value, and told."""
        failed = None
        reference_degC: float | None = None
        probes_degC: Mapping[str, float | None] = {}
        at_s = self._clock.now_s() - self._began_s
        try:
            reference_degC = self._lab.thermometer.read().temp_degC
        except LineError as error:
            failed = error
        try:
            probes_degC = self._lab.multiplexer.read().temps_degC
        except LineError as error:
            failed = error
        values = [reference_degC, *(probes_degC.get(name) for name in self._lab.probes)]
        self._rows.append([at_s, *(np.nan if value is None else value for value in values)])
        return failed
