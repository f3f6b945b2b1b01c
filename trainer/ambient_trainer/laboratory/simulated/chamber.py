"""A simulated ASCII-2 chamber, with the air inside it."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator

import numpy as np

from ambient_trainer.laboratory.clock import Clock
from ambient_trainer.laboratory.protocols import voetsch
from ambient_trainer.laboratory.simulated.air import Air
from ambient_trainer.laboratory.simulated.terminal import SimulatedInstrument, Work
from ambient_trainer.simulator.device import Chamber

_BAUD = 9600
_WORK_S = 0.08  # between a question and the first byte of its answer; chosen
_TO_ME = "$00"
_MALFORMED = b"\r"  # the manual leaves it open: this, or silence
_NUMBER = r"-?\d+\.\d"
_SET = re.compile(rf"E({(' ' + _NUMBER) * voetsch.VALUES}) ([01]{{{voetsch.OUTPUTS}}})")
_GRADIENT = re.compile(rf"U({(' ' + _NUMBER) * 2})(?: {_NUMBER})*")
_LOWEST_DEGC, _HIGHEST_DEGC = -45.0, 185.0


class SimulatedChamber(SimulatedInstrument):
    """The chamber, stopped and at room temperature; ``pause_s`` is that of a later controller, deaf for so long."""

    def __init__(
        self,
        clock: Clock,
        *,
        folder: str | None = None,
        room_degC: float = 22.0,
        dynamics: Chamber | None = None,
        seed: int | np.random.Generator = 0,
        pause_s: float = 0.0,
    ) -> None:
        self._air = Air(clock.now_s(), room_degC, dynamics or Chamber.shipped(), seed)
        self._pause_s = pause_s
        self._deaf_until_s = -math.inf
        self._heard = b""
        self._nominal: tuple[float, ...] = (room_degC, 0.0, 0.0, 0.0, 0.0)
        self._outputs: tuple[bool, ...] = (False,) * voetsch.OUTPUTS
        self._fault: voetsch.FaultText | None = None
        self._broken = False
        super().__init__("chamber", clock, _BAUD, folder)

    def air_degC(self, at_s: float | None = None) -> float:
        """The true air, now or at a time of the clock since its start."""
        return self._air.at(self._clock.now_s() if at_s is None else at_s)

    @property
    def held_degC(self) -> float | None:
        """The set point that it holds; None while it is stopped."""
        held = self._outputs[voetsch.START] and self._outputs[voetsch.TEMPERATURE]
        return self._nominal[0] if held else None

    def raise_alarm(self, number: int, text: str) -> None:
        """Let something break: the chamber stops, and does not start before that is mended and acknowledged."""
        with self._lock:
            self._fault, self._broken = voetsch.FaultText(number, text), True
            self._put(self._nominal, self._outputs)

    def clear_alarm(self) -> None:
        """Mend what broke; it still wants to be acknowledged."""
        with self._lock:
            self._broken = False

    def _hear(self, data: bytes) -> Iterator[Work]:
        *whole, self._heard = (self._heard + data).split(b"\r")
        for line in whole:
            now_s = self._clock.now_s()
            if now_s < self._deaf_until_s:
                continue
            self._deaf_until_s = now_s + self._pause_s
            text = line.strip(b"\n").decode("ascii", "replace")
            if text.startswith(_TO_ME):
                yield Work(_WORK_S, self._answer(text.removeprefix(_TO_ME)))

    def _answer(self, text: str) -> bytes:
        if text == "I":
            actual_degC = round(self._air.at(self._clock.now_s()), 1) + 0.0
            return voetsch.state_line(voetsch.State(self._nominal, (actual_degC,) * voetsch.VALUES, self._outputs))
        if text == "F":
            return voetsch.fault_line(self._fault or voetsch.FaultText(0, ""))
        if text == "Q":
            self._fault = self._fault if self._broken else None
            return voetsch.DONE_LINE
        if match := _SET.fullmatch(text):
            nominal = tuple(float(number) for number in match[1].split())
            if _LOWEST_DEGC <= nominal[0] <= _HIGHEST_DEGC:
                self._put(nominal, tuple(bit == "1" for bit in match[2]))
                return voetsch.DONE_LINE
        if match := _GRADIENT.fullmatch(text):
            up_K_min, down_K_min = (float(number) for number in match[1].split())
            self._air.limit(self._clock.now_s(), up_K_min, down_K_min)
            return voetsch.DONE_LINE
        return _MALFORMED

    def _put(self, nominal: tuple[float, ...], outputs: tuple[bool, ...]) -> None:
        run = outputs[voetsch.START] and self._fault is None
        self._nominal = nominal
        self._outputs = (*outputs[: voetsch.START], run, *outputs[voetsch.START + 1 :])
        self._air.drive(self._clock.now_s(), self.held_degC)
