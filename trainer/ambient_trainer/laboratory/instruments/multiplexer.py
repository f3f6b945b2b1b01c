"""The multiplexer: a scan is one answer, in which every reading stands beside its channel's number."""

from __future__ import annotations

from collections.abc import Mapping

from ambient_model.faults import Fault, Refused
from ambient_trainer.laboratory.clock import Clock, RealClock
from ambient_trainer.laboratory.instruments.offsets import ProbeOffset
from ambient_trainer.laboratory.instruments.readings import MultiplexerReading
from ambient_trainer.laboratory.line import Answer, Line, LineError, Question, Silent
from ambient_trainer.laboratory.protocols import agilent

_BAUD = 57600
THERMOCOUPLES = "BEJKNRST"

_ERROR = Question(agilent.ERROR, "an error's number and text", lambda reply: isinstance(reply, agilent.ErrorText))
_IDENTITY = Question(agilent.IDENTITY, "the identity of a 34970A", lambda reply: isinstance(reply, agilent.Identity))


class NotUnderstood(LineError):
    """The multiplexer refuses, and has said why."""

    mend = "switched off, it forgets its scan: the next reading sets it up again"


class Multiplexer:
    """A 34970A on the serial line at ``port``; ``probes`` maps a name to its channel."""

    def __init__(
        self,
        port: str,
        probes: Mapping[str, int],
        offsets: Mapping[str, ProbeOffset] | None = None,
        *,
        thermocouple: str = "K",
        name: str = "multiplexer",
        clock: Clock | None = None,
        baud: int = _BAUD,
        timeout_s: float = 5.0,
    ) -> None:
        _check(name, probes, offsets or {}, thermocouple)
        self.name = name
        self.port = port
        self._names = dict(sorted(((channel, probe) for probe, channel in probes.items())))
        self._offsets = dict(offsets or {})
        self._thermocouple = thermocouple
        self._line: Line[agilent.Reply] = Line(
            name, port, baud, agilent.Decoder, _ERROR, clock or RealClock(), timeout_s, xonxoff=True
        )
        channels = tuple(self._names)
        self._scan = Question(
            agilent.READ,
            f"{len(channels)} reading{'s' * (len(channels) > 1)}, of {agilent.channel_list(channels).decode('ascii')}",
            lambda reply: isinstance(reply, agilent.Scan) and reply.channels == channels,
        )
        self._configured = False

    def identify(self) -> str:
        """Maker, model and firmware; raises :class:`LineError` where it is no 34970A."""
        identity = self._line.ask(_IDENTITY).reply
        assert isinstance(identity, agilent.Identity)
        if identity.model != "34970A":
            raise LineError(self.name, self.port, _IDENTITY.expected, f"that of a {identity.maker} {identity.model}")
        return f"{identity.maker} {identity.model}, firmware {identity.firmware}"

    def configure(self) -> None:
        """Reset it and set up the scan; raises :class:`LineError` with its own words where it refuses."""
        self.identify()
        self._line.tell(agilent.RESET)
        self._line.tell(agilent.configure(self._names, self._thermocouple))
        self._line.tell(agilent.CHANNELS_WITH_READINGS)
        error = self._line.ask(_ERROR).reply
        assert isinstance(error, agilent.ErrorText)
        if error.number:
            raise NotUnderstood(self.name, self.port, "the scan to be set up", f"error {error}")
        self._configured = True

    def read(self) -> MultiplexerReading:
        """One scan, the offsets added; raises :class:`LineError`."""
        if not self._configured:
            self.configure()
        try:
            asked_s, answered_s, scan = self._scanned()
        except LineError:
            self._configured = False  # it may have been switched off in between: that forgets the scan
            raise
        assert isinstance(scan, agilent.Scan)
        temps_degC = {name: self._corrected(name, value) for name, value in zip(self._names.values(), scan.readings)}
        return MultiplexerReading(asked_s, answered_s, temps_degC)

    def close(self) -> None:
        """Give the port back."""
        self._line.close()
        self._configured = False

    def _scanned(self) -> Answer[agilent.Reply]:
        try:
            return self._line.ask(self._scan)
        except Silent as silent:
            error = self._line.mark()  # it is silent where it did not understand, and then says so
            if isinstance(error, agilent.ErrorText) and error.number:
                got = f"{silent.got}, and to SYST:ERR? {error}"
                raise NotUnderstood(self.name, self.port, self._scan.expected, got) from silent
            raise

    def _corrected(self, name: str, reading_degC: float | None) -> float | None:
        if reading_degC is None or name not in self._offsets:
            return reading_degC
        return reading_degC + self._offsets[name].at(reading_degC)


def _check(name: str, probes: Mapping[str, int], offsets: Mapping[str, ProbeOffset], thermocouple: str) -> None:
    faults = []
    if not probes:
        faults.append(Fault("probes", "none", "name at least one, with its channel"))
    channels = list(probes.values())
    for probe, channel in probes.items():
        place = f"probes.{probe}"
        if not (100 < channel < 400 and channel % 100):
            faults.append(Fault(place, f"channel {channel}", "a channel is its slot, 1 to 3, and two digits, as 101"))
        elif channels.count(channel) > 1:
            faults.append(Fault(place, f"channel {channel} stands twice", "give each probe a channel of its own"))
    for probe in offsets.keys() - probes.keys():
        faults.append(Fault(f"offsets.{probe}", "no probe has this name", f"the probes are {', '.join(probes)}"))
    if thermocouple not in THERMOCOUPLES or len(thermocouple) != 1:
        faults.append(Fault("thermocouple", repr(thermocouple), f"it is one of {', '.join(THERMOCOUPLES)}"))
    if faults:
        raise Refused(name, faults)
