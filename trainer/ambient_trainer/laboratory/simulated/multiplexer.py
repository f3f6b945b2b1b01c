"""A simulated 34970A with thermocouples, each with its lag, its noise and its own constant error."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np

from ambient_trainer.laboratory.clock import Clock
from ambient_trainer.laboratory.protocols import agilent
from ambient_trainer.laboratory.simulated.terminal import XOFF, XON, SimulatedInstrument, Work
from ambient_trainer.lti.lag import lag_weights
from ambient_trainer.simulator import constants as c

_BAUD = 57600
_IDENTITY = b"HEWLETT-PACKARD,34970A,0,13-2-2\r\n"
_WORK_S = 0.01  # chosen, as the two below
_RESET_S = 0.3
_CHANNEL_S = 0.06  # a relay, and a reading over some periods of the mains
_MOST_ERRORS = 10
_LONGEST_MEMORY_S = 60.0  # after which a probe has forgotten where it came from

Ambient = Callable[[float], float]


class SimulatedMultiplexer(SimulatedInstrument):
    """The multiplexer; ``ambient`` is a callable from the clock's time to degC, or a mapping of such by channel."""

    def __init__(
        self,
        clock: Clock,
        ambient: Ambient | Mapping[int, Ambient],
        *,
        channels: Sequence[int],
        folder: str | None = None,
        seed: int = 0,
        errors_K: Mapping[int, float] | None = None,
    ) -> None:
        random = np.random.default_rng(seed)
        by_channel = ambient if isinstance(ambient, Mapping) else dict.fromkeys(channels, ambient)
        self._probes = {
            channel: _Probe(by_channel[channel], (errors_K or {}).get(channel, _drawn(random)), random)
            for channel in channels
        }
        self._heard = b""
        self._errors: deque[agilent.ErrorText] = deque()
        self._configured: list[int] = []
        self._scanned: list[int] = []
        self._with_channels = False
        super().__init__("multiplexer", clock, _BAUD, folder)

    def open_circuit(self, channel: int) -> None:
        """Let a thermocouple come off."""
        self._probes[channel].open = True

    def mend(self, channel: int) -> None:
        """Put it on again."""
        self._probes[channel].open = False

    def error_K(self, channel: int) -> float:
        """What a probe reads too much."""
        return self._probes[channel].error_K

    def restart(self) -> None:
        """Switch it off and on again: it forgets its scan."""
        with self._lock:
            self._due.clear()
            self._heard = b""
            self._errors.clear()
            self._reset()

    def _hear(self, data: bytes) -> Iterator[Work]:
        *whole, self._heard = (self._heard + data).split(b"\n")
        for line in whole:
            for command in line.decode("ascii", "replace").strip().upper().split(";"):
                yield from self._do(command.strip())

    def _do(self, command: str) -> Iterator[Work]:
        head, _, argument = command.partition(" ")
        match _short(head):
            case "*IDN?":
                yield Work(_WORK_S, _IDENTITY)
            case "*RST":
                yield Work(0.0, XOFF)  # its buffer is small, and it does not listen meanwhile
                self._reset()
                yield Work(_RESET_S, XON)
            case "*CLS":
                self._errors.clear()
            case "SYST:ERR?":
                error = self._errors.popleft() if self._errors else agilent.ErrorText(0, "No error")
                yield Work(_WORK_S, f"{error}\r\n".encode("ascii"))
            case "CONF:TEMP" if argument.startswith("TC,"):
                self._reset()
                self._configured = self._scanned = self._channels(argument[len("TC,K,") :])
            case "ROUT:SCAN":
                self._scanned = self._channels(argument)
            case "FORM:READ:CHAN" if argument in ("ON", "OFF"):
                self._with_channels = argument == "ON"
            case "READ?":
                yield from self._scan()
            case "":
                pass
            case _:
                self._complain(-113, "Undefined header")

    def _scan(self) -> Iterator[Work]:
        if not self._scanned or not set(self._scanned) <= set(self._configured):
            self._complain(-221, "Settings conflict")
            return
        now_s = self._clock.now_s()
        readings = tuple(
            self._probes[channel].read(now_s + (index + 1) * _CHANNEL_S) for index, channel in enumerate(self._scanned)
        )
        channels = tuple(self._scanned) if self._with_channels else None
        yield Work(len(readings) * _CHANNEL_S, agilent.scan_line(agilent.Scan(readings, channels)))

    def _channels(self, text: str) -> list[int]:
        """The channels of a list such as ``(@101:103,105)``, in the instrument's order."""
        found: set[int] = set()
        for part in text.strip().removeprefix("(@").removesuffix(")").split(","):
            first, _, last = part.partition(":")
            if not first.isdigit() or not (last or first).isdigit():
                self._complain(-224, "Illegal parameter value")
                return []
            found.update(range(int(first), int(last or first) + 1))
        if not found <= self._probes.keys():
            self._complain(-224, "Illegal parameter value")
            return []
        return sorted(found)

    def _reset(self) -> None:
        self._configured, self._scanned = [], []
        self._with_channels = False

    def _complain(self, number: int, text: str) -> None:
        if len(self._errors) < _MOST_ERRORS:
            self._errors.append(agilent.ErrorText(number, text))
        else:
            self._errors[-1] = agilent.ErrorText(-350, "Error queue overflow")


class _Probe:
    """A thermocouple behind its lag: exact where the air goes straight from second to second."""

    def __init__(self, ambient: Ambient, error_K: float, random: np.random.Generator) -> None:
        self.error_K = error_K
        self.open = False
        self._ambient = ambient
        self._random = random
        self._felt: tuple[float, float, float] | None = None

    def read(self, at_s: float) -> float | None:
        """What the instrument makes of it; None where it is open."""
        felt_degC = self._feel(at_s)
        if self.open:
            return None
        noise_K = c.PROBE_NOISE_DEGC * float(self._random.standard_normal())
        return round(felt_degC + self.error_K + noise_K, c.PROBE_DIGITS)

    def _feel(self, at_s: float) -> float:
        if self._felt is None or at_s - self._felt[0] > _LONGEST_MEMORY_S:
            begin_degC = self._ambient(at_s - _LONGEST_MEMORY_S)
            self._felt = (at_s - _LONGEST_MEMORY_S, begin_degC, begin_degC)
        last_s, air_degC, felt_degC = self._felt
        steps = max(math.ceil(at_s - last_s), 1)
        step_s = (at_s - last_s) / steps
        if step_s <= 0.0:
            return felt_degC
        lag = lag_weights(c.PROBE_LAG_S, step_s)
        for step in range(1, steps + 1):
            before_degC, air_degC = air_degC, self._ambient(last_s + step * step_s)
            felt_degC = lag.step(felt_degC, before_degC, air_degC)
        self._felt = (at_s, air_degC, felt_degC)
        return felt_degC


def _drawn(random: np.random.Generator) -> float:
    return c.PROBE_CALIBRATION_DEGC * float(random.standard_normal())


def _short(head: str) -> str:
    """A command's head in SCPI's short form."""
    long = {
        "SYSTEM": "SYST",
        "ERROR?": "ERR?",
        "CONFIGURE": "CONF",
        "TEMPERATURE": "TEMP",
        "ROUTE": "ROUT",
        "FORMAT": "FORM",
        "READING": "READ",
        "CHANNEL": "CHAN",
    }
    return ":".join(long.get(part, part) for part in head.split(":"))
