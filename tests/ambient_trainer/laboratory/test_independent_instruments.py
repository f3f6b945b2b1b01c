"""Instruments as public programs and manuals show them, written from those and never from the drivers here.

A seeded night has one of each kind, of whose answers a tenth is late, doubled, one behind, cut or in noise; every
reading is compared with what the instrument held between question and answer. ``AMBIENT_NIGHTS=50`` runs fifty.

Chambers: `Climate.py` in HelgeStenstrom/sockets (emulator of Vc3 7060 and Vt3 7060: address 01, moving set point, one
slope at a time, 32 outputs, an unknown command is answered by a sentence, and `?` by many lines, of which some name the
fields of the commands; with an external cabinet some fields of a state are no pairs); `Ascii2Protocol.cs` in
mukky89/chamber_fos_soft (VT3 7034, CR LF on some firmware); `VT4002.py` in ondrejh/VT4002 (address 01, five pairs, 16
outputs, CR LF); `CTC_VOETSCH_VC4060.vb` in BednarJan/Instruments_DCA (one pair, 16 outputs and a Z); `thermo_comm.py`
in GustavEckerbom/DMM_samples (one value set, outputs behind the gradients). Multiplexers: 34970A/34972A Command
Reference, and the DAQ970A's: CONFigure makes the scan list, and the settings of each channel stay; an open sensor reads
9.9E+37; a resistance thermometer has 100 ohm unless SENSe:TEMPerature:TRANsducer says another. Thermometer:
`easybus.py` in rgieseke/pyEasybus, GMH 3750, with the unit of its display.
"""

import contextlib
import functools
import os
import random
import re
import select
import socket
import subprocess
import threading
import time
import tty

import numpy as np
import pytest

from ambient_trainer.laboratory import run as run_module
from ambient_trainer.laboratory import workers
from ambient_trainer.laboratory.collect import resume
from ambient_trainer.laboratory.instruments import settings
from ambient_trainer.laboratory.journal import read_journal
from ambient_trainer.laboratory.messages import MULTIPLEXER, InstrumentError, Sample
from ambient_trainer.laboratory.run import Ending
from ambient_trainer.laboratory.watchdog import Watchdog

from .conftest import in_real_time, minutes

SPEED = 120.0
MODELS = ("34970A", "34972A", "DAQ970A")


class Far:
    """The far end of a line, in a thread; with ``faulty``, a tenth of its answers goes wrong in a drawn way."""

    WAYS = ("late", "doubled", "behind", "cut", "noise")
    asked_with, ending = b"\r", "\r"
    """With what a question ends, and an answer, where both are lines."""

    def __init__(self, tcp=False, seed=0):
        self.random, self.faulty, self.faults = random.Random(seed), 0.0, 0
        self.last, self.behind = b"", 0
        self.server = socket.create_server(("127.0.0.1", 0)) if tcp else None
        if self.server:
            self.port = f"socket://127.0.0.1:{self.server.getsockname()[1]}"
        else:
            self.near, self.far = os.openpty()
            tty.setraw(self.far)
            self.port = os.ttyname(self.far)
        self.woken, self.wake = os.pipe()
        self.thread = threading.Thread(target=self._serve, daemon=True)
        self.thread.start()

    def _serve(self):
        if self.server and not self._readable(self.server):
            return
        line, rest = self.server.accept()[0].detach() if self.server else self.near, b""
        self.write = functools.partial(os.write, line)
        with contextlib.suppress(OSError):
            while self._readable(line) and (data := os.read(line, 256)):
                rest = self.take(rest + data)
        if self.server:
            os.close(line)

    def _readable(self, waited):
        """Whether something comes, before it is closed: a thread that still reads takes the bytes of the next line."""
        return self.woken not in select.select([waited, self.woken], [], [])[0]

    def take(self, data):
        *lines, rest = data.split(self.asked_with)
        for line in lines:
            if (reply := self.reply(line.strip().decode())) is not None:
                self.answer((reply + self.ending).encode())
        return rest

    def answer(self, reply):
        """Send a reply, as it should be or not."""
        way = self.random.choice(self.WAYS) if self.random.random() < self.faulty else ""
        self.faults += bool(way)
        if way == "behind":
            self.behind = self.random.randint(1, 4)
        if self.behind:
            self.behind -= 1
            reply, self.last = self.last, reply
        else:
            self.last = reply
        if way == "late":
            time.sleep(self.random.uniform(0.05, 0.8))
        if way == "noise":
            self.write(self.random.randbytes(self.random.randint(1, 9)))
        self.write(reply[: self.random.randint(0, len(reply) - 1)] if way == "cut" and reply else reply)
        if way == "doubled":
            self.write(reply)

    def close(self):
        os.write(self.wake, b"!")
        self.thread.join()
        for end in (self.wake, self.woken, *(() if self.server else (self.near, self.far))):
            os.close(end)
        if self.server:
            self.server.close()


VC3 = ("CV01", "CV02", "SV01", "MV01", "MV02", "MV03", "MV04")
CABINET = ("CV01", "CV02", "CV03", "SV01", "SV02", "MV01", "MV02", "MV03", "MV04")


class Chamber(Far):
    """A chamber of the ``fields``, some single; its slope is per minute of a clock ``speed`` times as fast.

    An ``unknown`` command has no reply, an empty line or a sentence; only the last kind knows ``?``.
    """

    def __init__(
        self, fields=VC3, single=(), bits=32, address="01", ending="\r", after="", slopes="one", faults=False,
        unknown="'{}' is an unknown command.", speed=1.0, **line,
    ):  # fmt: skip
        self.fields, self.single, self.bits, self.ending, self.after = fields, single, "0" * bits, ending, after
        self.address, self.slopes, self.knows_faults, self.speed = address, slopes, faults, speed
        self.unknown, self.helps = unknown, bool(unknown)
        self.others = tuple(1.5 * place for place in range(1, len(fields)))
        self.wanted, self.shown_K, self.slope = 20.0, 0.0, 0.0
        self.began, self.since = 20.0, time.monotonic()
        self.received = []
        self.air = None
        super().__init__(**line)

    def nominal(self):
        """The set point on its way."""
        moved = self.slope * (time.monotonic() - self.since) * self.speed / 60.0
        return self.wanted if not self.slope else self.began + np.clip(self.wanted - self.began, -moved, moved)

    def reply(self, command):
        if not command.startswith(f"${self.address}"):
            return None
        self.received.append((time.monotonic(), command[3:]))
        letter, *parts = command[3:].split(" ")
        if letter == "I":
            nominal = self.nominal()
            numbers = [nominal + self.shown_K, self.air() if self.air else nominal]
            for name, value in zip(self.fields[1:], self.others):
                numbers += [value] if name in self.single else [value, 23.8]
            return " ".join(f"{number:06.1f}" for number in numbers) + f" {self.bits}{self.after}"
        if letter == "E" and len(parts) == len(self.fields) + 1 and len(parts[-1]) == len(self.bits):
            self.began, self.since = self.nominal(), time.monotonic()
            self.wanted, self.others, self.bits = float(parts[0]), tuple(map(float, parts[1:-1])), parts[-1]
            return "0"
        if letter == "U":
            return self.set_slopes(parts)
        if letter == "F" and self.knows_faults:
            return "00"
        if letter == "?" and self.helps:
            return self.help()
        return self.unknown and self.unknown.format(command)

    def help(self):
        """As the chamber of the source prints it, some of the outputs left out of the first list."""
        read = [name for name in self.fields for _ in range(1 if name in self.single else 2)]
        outputs = [f"DO{place:02d}" for place in range(len(self.bits))]
        unused = [f"{name}  unused" for name in (*self.fields, *outputs)]
        lines = ["Simulated Vc3 7060 climate chamber.", "EXAMPLE OF AN ASCII E-STRING ", "DESCRIPTION: ", *unused]
        lines[2:2] = [" ".join([f"${self.address}E", *self.fields, *outputs[:3], *outputs[-15:]]) + " <CR>", ""]
        lines += ["-" * 78, "EXAMPLE OF AN ASCII I-STRING ", f"${self.address}I<CR>", " ".join(read + outputs[:24])]
        return "\r\n".join([*lines, " ".join(outputs[24:]) + " DESCRIPTION: ", "CV01  nominal value Temperature", ""])

    def set_slopes(self, parts):
        if self.slopes == "outputs":
            up, down, bits = parts
            assert len(bits) == len(self.bits)
        else:
            up, down, _, _ = parts
        if self.slopes == "refused" or (self.slopes == "one" and float(up) and float(down)):
            return ""
        self.began, self.since = self.nominal(), time.monotonic()
        self.slope = float(up) or float(down)
        return "0"

    def set_points(self):
        return [(at_s, float(text.split(" ")[1])) for at_s, text in self.received if text.startswith("E")]


class Multiplexer(Far):
    """One of any model, each channel some kelvin above ``air``; ``open_channels`` have no sensor."""

    asked_with, ending = b"\n", "\r\n"

    def __init__(self, model="34970A", **line):
        self.model = model
        self.sensors, self.scanned, self.errors, self.open_channels, self.with_channels = {}, [], [], set(), False
        self.air = lambda: 20.0
        super().__init__(**line)

    def reply(self, line):
        head, _, rest = line.partition(" ")
        channels = [int(each) for each in re.findall(r"\b\d{3}\b", rest.partition("@")[2])]
        if head == "*IDN?":
            return f"Agilent Technologies,{self.model},MY44000001,1.17-1.12-02-02"
        if head == "SYST:ERR?":
            return self.errors.pop(0) if self.errors else '+0,"No error"'
        if head == "READ?" and self.scanned:
            time.sleep(0.002)
            air = self.air()
            texts = [f"{9.9e37 if each in self.open_channels else air + each % 100:+.8E}" for each in self.scanned]
            return ",".join(f"{text},{each}" if self.with_channels else text for text, each in zip(texts, self.scanned))
        if head == "*RST":
            self.sensors, self.scanned, self.with_channels = {}, [], False
        elif head == "CONF:TEMP":
            kind, of, *_ = rest.split(",")
            ohm = (100,) if kind.endswith("RTD") else ()
            self.sensors.update(dict.fromkeys(channels, (kind, of, *ohm)))
            self.scanned, self.with_channels = sorted(channels), False
        elif head == "ROUT:SCAN":
            self.scanned = sorted(channels)
        elif match := re.fullmatch("SENS:TEMP:TRAN:(F?RTD):RES", head):
            for each in channels:
                assert self.sensors[each][0] == match[1]
                self.sensors[each] = (*self.sensors[each][:2], int(rest.partition(",")[0]))
        elif line == "FORM:READ:CHAN ON":
            self.with_channels = True
        elif head != "*CLS":
            self.errors.append('-113,"Undefined header"')
        return None


def crc(first, second):
    helper = (first << 8) + second
    for _ in range(16):
        helper = (helper << 1) ^ 0x700 if helper & 0x8000 else helper << 1
    return ~(helper >> 8) & 0xFF


class Thermometer(Far):
    """It shows ``air`` in its display's unit: 1 degC, 2 degF, 3 K."""

    def __init__(self, unit=1, **line):
        self.unit, self.air = unit, lambda: 20.0
        super().__init__(**line)

    def take(self, data):
        while len(data) >= 3:
            size = 6 if data[1] & 0x06 else 3
            if len(data) < size:
                break
            if data[2] != crc(data[0], data[1]):
                data = data[1:]
                continue
            asked, data = data[:size], data[size:]
            if asked[:2] == b"\xfe\x00":
                self.answer(self.frame(0x05, self.value()))
            elif asked[:2] == b"\xfe\xc0":
                self.answer(self.frame(0xC5, 0x32407008))
            elif asked[1] == 242 and asked[3:5] == b"\x35\x00":
                self.answer(self.frame(0xF5, (0xCA00 << 16) | self.unit))
        return data

    def value(self):
        """As `value` of pyEasybus decodes it, the other way round: two decimals."""
        degC = self.air()
        shown = {2: degC * 9 / 5 + 32, 3: degC + 273.15}.get(self.unit, degC)
        return ((2 + 15) << 27) | ((round(shown * 100) - 0x2000000) & 0x07FFFFFF)

    @staticmethod
    def frame(second, number):
        groups = [(0xFE, second)] + [(~(half >> 8) & 0xFF, half & 0xFF) for half in (number >> 16, number & 0xFFFF)]
        return b"".join(bytes((*group, crc(*group))) for group in groups)


@pytest.fixture
def chamber(monkeypatch, closed):
    """Makes a chamber, or another instrument."""
    monkeypatch.setattr(workers, "_LEAST_WALL_S", 2.0)
    return lambda kind=Chamber, **of: closed(kind(**of))


QUIET = {"slopes": "pair", "unknown": None}
ONE_VALUE = {"fields": VC3[:1], "bits": 16, "address": "00"}
# what is there, and what a campaign gives of it; the outputs that are on while it runs
ROWS = {
    "Vc3 7060": ({}, {"model": "vc3-7060"}, {1}),
    "Vc3 7060 over TCP": ({"tcp": True, "ending": "\r\n"}, {"model": "vc3-7060", "values": 7, "outputs": 32}, {1}),
    "Vt3 7060, cabinet": ({"fields": CABINET, "single": ("SV01", "SV02")}, {"model": "vt3-7060"}, {1}),
    "VT3 7034": ({"fields": VC3[:5], "ending": "\r\n", "slopes": "pair", "unknown": ""}, {"model": "vt3-7034"}, {1}),
    "VT4002": ({**QUIET, "fields": VC3[:5], "bits": 16, "ending": "\r\n"}, {"model": "vt-4002"}, {1, 3}),
    "VC4060": ({**QUIET, **ONE_VALUE, "after": "Z"}, {"model": "vc-4060"}, {1, 3}),
    "thermo_comm": (
        {**ONE_VALUE, "ending": "\r\n", "slopes": "outputs", "faults": True},
        {"model": "one-value"},
        {1, 3},
    ),
    "no pairs, not asked": (
        {"fields": CABINET, "single": ("SV01", "SV02"), "unknown": None},
        {"model": "vt3-7060", "marker": None, "values": 9, "other_values": tuple(1.5 * each for each in range(1, 9))},
        {1},
    ),
    "as the first two states": ({**QUIET, "fields": VC3[:5], "address": "00"}, {"model": None, "alarms": False}, {1}),
}


def given(port, **values):
    return settings("voetsch-vt4004", port=port, **{"model": "vc3-7060", "timeout_s": 0.5, **values})


@pytest.mark.parametrize(("there", "campaign", "on"), ROWS.values(), ids=ROWS)
def test_each_is_driven_by_what_a_campaign_gives(chamber, driver_of, there, campaign, on):
    made = chamber(**there)
    driver = driver_of(given(made.port, **campaign))
    others = made.others
    for set_degC in (25.0, -7.5):
        driver.gradient(10.0, rising=set_degC > 20.0)
        driver.gradient(0.0)
        driver.set_point(set_degC)
        assert (made.wanted, made.others) == (set_degC, others)
        assert {index for index, bit in enumerate(made.bits) if bit == "1"} == on
        reading = driver.read()
        assert (reading.values["chamber_set_degC"], reading.values["chamber_on"], reading.note) == (set_degC, 1.0, None)
    driver.stop()
    assert "1" not in made.bits


def test_another_layout_than_the_one_given_or_seen_is_no_state(chamber, driver_of):
    made = chamber()
    for values in ({"outputs": 16}, {"values": 5}, {}):
        driver = driver_of(given(made.port, **values))
        if not values:
            driver.read()
            made.bits += "0"
        with pytest.raises(InstrumentError):
            driver.read()
        driver.close()


@pytest.mark.parametrize("answer", [None, "0", "'$01F' is an unknown command."])
def test_a_chamber_that_is_not_asked_for_faults_need_not_know_the_question(chamber, driver_of, answer):
    made = chamber()
    known = made.reply
    made.reply = lambda command: answer if command.endswith("F") else known(command)
    asked, not_asked = (driver_of(given(made.port, alarms=each)) for each in (True, False))
    with pytest.raises(InstrumentError, match="alarms: false"):
        asked.read()
    asked.close()
    assert not_asked.read().values["chamber_set_degC"] == 20.0


@pytest.mark.parametrize("model", MODELS)
def test_each_multiplexer_scans_the_sensors_of_each_channel(chamber, driver_of, model):
    probes = {"a": 102, "b": {"channel": 101, "sensor": "Pt100"}, "c": {"channel": 205, "sensor": "Pt100-4w"}}
    probes |= {"d": 310, "e": {"channel": 107, "sensor": "thermistor-10k"}, "f": {"channel": 301, "sensor": "J"}}
    probes |= {"g": {"channel": 302, "sensor": "Pt1000"}, "h": {"channel": 303, "sensor": "JPt100-4w"}}
    made = chamber(Multiplexer, model=model, tcp=True)
    driver = driver_of(settings("agilent-34970a", port=made.port, probes=probes, thermocouple="T"))
    assert model in driver.identify()
    made.open_channels = {205}
    expected = {"a": 22.0, "b": 21.0, "c": None, "d": 30.0, "e": 27.0, "f": 21.0, "g": 22.0, "h": 23.0}
    assert driver.read().values == {f"probe_{name}_degC": value for name, value in expected.items()}
    assert made.sensors == {
        101: ("RTD", "85", 100),
        102: ("TC", "T"),
        107: ("THER", "10000"),
        205: ("FRTD", "85", 100),
        301: ("TC", "J"),
        302: ("RTD", "85", 1000),
        303: ("FRTD", "91", 100),
        310: ("TC", "T"),
    }


VISA = """
spec: "1.0"
devices:
  daq:
    eom: {USB INSTR: {q: "\\n", r: "\\n"}}
    dialogues:
      - {q: "*IDN?", r: "Keysight Technologies,DAQ970A,MY58000001,A.02.02"}
      - {q: "READ?", r: "+2.15000000E+01,101,-9.90000000E+37,102"}
      - {q: "SYST:ERR?", r: '+0,"No error"'}
      - {q: "*RST"}
      - {q: "*CLS"}
      - {q: "CONF:TEMP TC,K,(@101,102)"}
      - {q: "ROUT:SCAN (@101,102)"}
      - {q: "FORM:READ:CHAN ON"}
resources:
  "USB0::0x2A8D::0x5101::MY58000001::INSTR": {device: daq}
"""


def test_a_multiplexer_is_a_visa_resource(tmp_path, monkeypatch, driver_of):
    (tmp_path / "daq.yaml").write_text(VISA)
    monkeypatch.setenv("PYVISA_LIBRARY", f"{tmp_path}/daq.yaml@sim")
    there, gone = (
        driver_of(settings("agilent-34970a", port=name, probes={"a": 101, "b": 102}, timeout_s=0.5))
        for name in ("USB0::0x2A8D::0x5101::MY58000001::INSTR", "USB0::1::2::3::INSTR")
    )
    for _ in range(3):
        assert there.read().values == {"probe_a_degC": 21.5, "probe_b_degC": None}
    with pytest.raises(InstrumentError, match="pyvisa-shell"):
        gone.read()


@pytest.mark.parametrize(("unit", "given_unit"), [(1, None), (2, None), (3, None), (2, "degF")])
def test_a_thermometer_is_asked_for_its_unit(chamber, driver_of, unit, given_unit):
    made = chamber(Thermometer, unit=unit)
    driver = driver_of(settings("greisinger-easybus", port=made.port, unit=given_unit))
    for degC in (20.0, -12.5):
        made.air = lambda degC=degC: degC
        assert driver.read().values["thermometer_degC"] == pytest.approx(degC, abs=0.006)
    if given_unit is None:
        made.unit = 21  # mbar
        time.sleep(0.06)
        with pytest.raises(InstrumentError, match=r"degC, degF or K.*21"):
            driver.read()


@pytest.fixture
def night_with(night):
    """Runs a night with such a chamber, and such ``others`` by role, that are ``faulty`` from the run's begin."""

    def run(made, steps, stop_s=None, chamber=None, others=None, speed=SPEED, faulty=(), **safety):
        changes = {f"safety.{key}": value for key, value in {"ambient_lost_s": 1e5, **safety}.items()}
        changes["device.timeout_s"] = 5.0 * speed  # what runs beside is a shell of this machine
        lab = night(steps, changes, speed)
        lab.began, lab.over_s, lab.kept = (), 0.0, lab.part.with_name("kept")

        def watch(run):
            if not lab.began:
                os.link(run.journal.path, lab.kept)
                lab.began = at_once(run.clock)
            if run.program.over:
                lab.over_s = lab.over_s or time.monotonic()
            for each in faulty:
                each.faulty = 0.1

        own = {"chamber": given(made.port, period_s=20.0, **(chamber or {})), **(others or {})}
        stop = [(stop_s, lambda there: setattr(lab, "stop", "stopped by SIGINT"))] if stop_s else []
        lab.events = lab.run(stop, monitor=watch, own=own)
        lab.complete = lab.trace.notes["complete"]
        return lab

    return run


def at_once(clock):
    """One moment by a clock and by the machine's: of many tries, the one with the least time in between."""
    tries = [(time.monotonic(), clock.now_s(), time.monotonic()) for _ in range(100)]
    before_s, now_s, after_s = min(tries, key=lambda each: each[2] - each[0])
    return now_s, 0.5 * (before_s + after_s)


@in_real_time
def test_a_set_point_does_not_wait_for_a_gradient_that_is_refused(chamber, night_with):
    made = chamber(slopes="refused")
    night = night_with(made, minutes((4, 35.0, (), 2.0), (2, 30.0)))
    assert [degC for _, degC in made.set_points()] == [35.0, 30.0, 20.0]
    assert (night.outcome.ending, night.outcome.safe) == (Ending.DEVIATED, True)
    assert night.complete.startswith("no: ")
    assert "gradient 2.0 K/min" in night.complete
    assert not night.part.exists()
    os.rename(night.kept, night.part)
    why = night.outcome.why
    night.run(work=resume)
    assert (night.outcome.ending, night.outcome.why) == (Ending.DEVIATED, why)


@in_real_time
def test_a_gradient_is_followed_and_lifted_at_the_end(chamber, night_with):
    made = chamber(speed=SPEED)
    night = night_with(made, minutes((8, 35.0, (), 2.5)), chamber={"gradient": "needed"}, confirm_s=60)
    assert (night.outcome.ending, night.complete) == (Ending.FINISHED, "yes")
    assert (made.slope, made.wanted) == (0.0, 20.0)


WAYS = {"go-on": Ending.DEVIATED, "wait": Ending.LIMIT, "end": Ending.LIMIT, "stopped": Ending.STOPPED}


@in_real_time
@pytest.mark.parametrize("way", WAYS)
def test_what_a_chamber_reports_instead_is_said_and_the_run_ends(chamber, night_with, monkeypatch, way):
    """It shows 31.5 for 25, and never the safe set point either."""
    monkeypatch.setattr(run_module, "_SAFE_S", 2.0)
    monkeypatch.setattr(run_module, "_LONGEST_WAIT_S", 120.0)
    made = chamber()
    made.shown_K = 6.5
    wanted = {"unconfirmed": way} if way != "stopped" else {}
    night = night_with(made, minutes((10, 25.0)), 480.0 if way == "stopped" else None, confirm_s=60, **wanted)
    (said,) = {text for text in night.events if "31.5" in text}
    assert "25.0 degC within 60 s" in said
    assert (night.outcome.ending, night.outcome.safe) == (WAYS[way], False)
    assert night.complete.startswith("no: ")
    assert (len(night.trace.time_s) < 600) == (way in ("end", "stopped", "wait"))
    assert night.part.exists() == (way != "go-on")
    assert way != "wait" or read_journal(str(night.part)).left.elapsed_s < night.trace.time_s[-1] - 100.0


@in_real_time
def test_a_program_waits_for_its_set_point_and_goes_on(chamber, night_with):
    made = chamber()
    made.shown_K = 6.5
    threading.Timer(540 / SPEED, lambda: setattr(made, "shown_K", 0.0)).start()
    night = night_with(made, minutes((6, 25.0)), confirm_s=30, unconfirmed="wait")
    assert (night.outcome.ending, night.outcome.safe) == (Ending.DEVIATED, True)
    assert len(night.trace.time_s) > 420


@pytest.mark.parametrize("slopes", ["pair", "refused"])
def test_after_a_crash_the_gradient_is_lifted_at_an_even_pace_and_each_step_is_logged(chamber, tmp_path, slopes):
    made = chamber(slopes=slopes)
    made.wanted, made.bits, made.began, made.slope = 50.0, "01" + "0" * 30, 50.0, 6.0 if slopes == "pair" else 0.0
    log = tmp_path / "safety.log"
    dog = Watchdog(given(made.port), workers.Target(20.0, 0.0, urgent=True), str(log))
    process = subprocess.Popen(dog.argv, stdin=subprocess.PIPE)
    process.stdin.close()
    began_s = time.monotonic()
    assert process.wait(timeout=30) == 0
    assert (made.wanted, made.slope) == (20.0, 0.0)
    assert len(made.received) < 60
    assert len(made.set_points()) <= 2 + (time.monotonic() - began_s)
    if slopes == "pair":
        order = ("set point 20.0 degC is sent", "gradient 0 K/min is sent", "confirmed the set point 20.0 degC")
        assert all(step in log.read_text() for step in order)


NIGHT_SPEED = 40.0


def swinging(at_s):
    """Air that is another one at any time: 1 K in a second of the run, between -40 and 140 degC."""
    return -40.0 + abs((at_s * NIGHT_SPEED) % 360.0 - 180.0)


def held(night, begin_s, end_s):
    """The least and the largest air between two times of the run."""
    run_s, wall_s = night.began
    at_s = wall_s + (np.linspace(begin_s, end_s, 200) - run_s) / NIGHT_SPEED
    air_degC = swinging(at_s)
    slack_K = NIGHT_SPEED * (at_s[1] - at_s[0])
    return air_degC.min() - slack_K, air_degC.max() + slack_K


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(int(os.environ.get("AMBIENT_NIGHTS", "2"))))
def test_whatever_instruments_answer_no_reading_is_wrong_and_the_chamber_ends_safe(chamber, night_with, seed):
    draw = random.Random(seed)
    there, campaign, _ = draw.choice(list(ROWS.values()))
    made = chamber(speed=NIGHT_SPEED, seed=seed, **there)
    multiplexer = chamber(Multiplexer, model=draw.choice(MODELS), tcp=draw.random() < 0.5, seed=seed + 1)
    thermometer = chamber(Thermometer, unit=draw.choice((1, 2, 3)), seed=seed + 2)
    far = (made, multiplexer, thermometer)
    for each in far:
        each.air = lambda: swinging(time.monotonic())
    probes = {"air1": 101, "air2": {"channel": 102, "sensor": "Pt100"}, "air3": 203}
    probes |= {"air4": {"channel": 110, "sensor": "T"}}
    others = {
        "multiplexer": settings("agilent-34970a", port=multiplexer.port, period_s=4.0, probes=probes),
        "thermometer": settings("greisinger-easybus", port=thermometer.port, period_s=6.0),
    }
    steps = minutes((2, draw.choice((35.0, -5.0)), (), draw.choice((None, 4.0))), (2, 28.0))
    limits = {"chamber.low_degC": -45, "chamber.high_degC": 150, "confirm_s": 400}
    night = night_with(made, steps, None, campaign, others, NIGHT_SPEED, far, **limits)
    assert (night.outcome.safe, made.wanted, made.slope) == (True, 20.0, 0.0)
    assert time.monotonic() - night.over_s < 60.0
    assert night.outcome.finished == (night.complete == "yes")
    assert sum(each.faults for each in far) >= 5
    columns = {f"probe_{name}_degC": above for name, above in zip(("air1", "air2", "air3", "air4"), (1, 2, 3, 10))}
    named = given(made.port, **campaign)
    columns |= {"thermometer_degC": 0, **({"chamber_degC": 0} if named.alarms or named.marker else {})}
    checked = dict.fromkeys(columns, 0)
    samples = read_journal(str(night.kept)).of(Sample)
    for sample in samples:
        low_degC, high_degC = held(night, sample.asked_s, sample.answered_s)
        for name in columns.keys() & sample.values.keys():
            value = sample.values[name] - columns[name]
            assert low_degC - 0.06 <= value <= high_degC + 0.06, (sample, low_degC, high_degC)
            checked[name] += 1
    assert min(checked.values()) > 3
    trace = night.trace
    rows = np.flatnonzero(np.isfinite(trace.reference))
    scans = [each for each in samples if each.source == MULTIPLEXER]
    known = {int(each.at_s + 1e-6) for each in scans if each.answered_s - each.asked_s <= 2.0}
    assert set(rows) == {second for second in known if second < len(trace.time_s)}, "gaps are empty cells"
    assert len(rows) > 0
    for row in rows:
        low_degC, high_degC = held(night, trace.time_s[row] - 1.0, trace.time_s[row] + 2.0)
        assert low_degC - 0.01 <= trace.reference[row] - 4.0 <= high_degC + 0.01
