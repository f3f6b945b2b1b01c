"""A simulated EASYBus thermometer, which switches itself off."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

from ambient_trainer.laboratory.clock import Clock
from ambient_trainer.laboratory.protocols import easybus
from ambient_trainer.laboratory.simulated.terminal import SimulatedInstrument, Work

_BAUD = 4800
_WORK_S = 0.02  # chosen
_NUMBER = 0x32407008
_DECIMALS = 2
_REQUEST = 3


class SimulatedThermometer(SimulatedInstrument):
    """The thermometer; ``ambient`` is a callable from the clock's time to degC, ``auto_off_s`` None for never."""

    def __init__(
        self,
        clock: Clock,
        ambient: Callable[[float], float],
        *,
        address: int = 1,
        folder: str | None = None,
        auto_off_s: float | None = None,
        error_degC: float = 0.0,
    ) -> None:
        self._ambient = ambient
        self._address = address
        self._auto_off_s = math.inf if auto_off_s is None else auto_off_s
        self._error_degC = error_degC
        self._on_since_s = clock.now_s()
        self._sensor = True
        self._heard = b""
        super().__init__("thermometer", clock, _BAUD, folder)

    def switch_off(self) -> None:
        """Press its key for long: it says nothing any more."""
        self._on_since_s = -math.inf

    def switch_on(self) -> None:
        """Press its key; it goes on for another ``auto_off_s``."""
        self._on_since_s = self._clock.now_s()

    def pull_sensor(self) -> None:
        """Pull its sensor out."""
        self._sensor = False

    def push_sensor(self) -> None:
        """Put it in again."""
        self._sensor = True

    def _hear(self, data: bytes) -> Iterator[Work]:
        now_s = self._clock.now_s()
        if not now_s - self._on_since_s < self._auto_off_s:
            self._heard = b""
            return
        self._heard += data
        while len(self._heard) >= _REQUEST:
            if easybus.check(*self._heard[:2]) != self._heard[2]:
                self._heard = self._heard[1:]
                continue
            request, self._heard = self._heard[:_REQUEST], self._heard[_REQUEST:]
            code = request[1] >> 4
            if request == easybus.request(self._address, code):
                yield Work(_WORK_S, self._answer(code, now_s))

    def _answer(self, code: int, now_s: float) -> bytes:
        if code == easybus.IDENTITY:
            return self._reply(code, easybus.body_of_number(_NUMBER))
        if code != easybus.VALUE:
            return b""
        if not self._sensor:
            return self._reply(code, easybus.body_of_fault(easybus.NO_SENSOR))
        return self._reply(code, easybus.body_of_value(self._ambient(now_s) + self._error_degC, _DECIMALS))

    def _reply(self, code: int, body: bytes) -> bytes:
        return easybus.reply(self._address, code, body, faulty=not self._sensor)
