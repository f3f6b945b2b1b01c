"""Chambers as public programs for them show them, written from those and never from the driver here.

Sources: `Climate.py` in HelgeStenstrom/sockets (emulator of Vc3 7060 and Vt3 7060: address 01, moving set point, one
slope at a time, 32 outputs, an unknown command is answered by a sentence); `Ascii2Protocol.cs` in
mukky89/chamber_fos_soft (VT3 7034, CR LF on some firmware); `VT4002.py` in ondrejh/VT4002 (address 01, five pairs, 16
outputs, CR LF); `CTC_VOETSCH_VC4060.vb` in BednarJan/Instruments_DCA (one pair, 16 outputs and a Z); `thermo_comm.py`
in GustavEckerbom/DMM_samples (one value set, outputs behind the gradients).
"""

import os
import re
import socket
import subprocess
import threading
import time
import tty

import numpy as np
import pytest
from pydantic import ValidationError

from ambient_trainer.data.trace import load_trace
from ambient_trainer.laboratory import run as run_module
from ambient_trainer.laboratory import workers
from ambient_trainer.laboratory.campaign import load_campaign
from ambient_trainer.laboratory.collect import Job, collect, resume
from ambient_trainer.laboratory.instruments import settings
from ambient_trainer.laboratory.instruments.voetsch_vt4004 import Driver, Settings
from ambient_trainer.laboratory.messages import Clock, InstrumentError
from ambient_trainer.laboratory.run import Ending, Supervision
from ambient_trainer.laboratory.set_point_limits import SetPointLimits
from ambient_trainer.laboratory.simulation.laboratory import simulated_laboratory
from ambient_trainer.laboratory.watchdog import Watchdog

SPEED = 120.0
in_real_time = pytest.mark.slow  # a busy machine misses samples


class Chamber:
    """One at a pseudo-terminal or a TCP port; its slope is per minute of a clock ``speed`` times as fast."""

    def __init__(
        self, pairs=7, bits=32, address="01", ending="\r", after="", slopes="one", faults=False, tcp=False, speed=1.0
    ):
        self.pairs, self.bits, self.address, self.ending, self.after = pairs, "0" * bits, address, ending, after
        self.slopes, self.faults, self.speed = slopes, faults, speed
        self.wanted, self.shown_K, self.slope = 20.0, 0.0, 0.0
        self.began, self.since = 20.0, time.monotonic()
        self.received = []
        self.server = socket.create_server(("127.0.0.1", 0)) if tcp else None
        if self.server:
            self.port = f"socket://127.0.0.1:{self.server.getsockname()[1]}"
        else:
            self.near, self.far = os.openpty()
            tty.setraw(self.far)
            self.port = os.ttyname(self.far)
        self.thread = threading.Thread(target=self._serve, daemon=True)
        self.thread.start()

    def nominal(self):
        """The set point on its way."""
        moved = self.slope * (time.monotonic() - self.since) * self.speed / 60.0
        return self.wanted if not self.slope else self.began + np.clip(self.wanted - self.began, -moved, moved)

    def _serve(self):
        if self.server:
            self.connection = self.server.accept()[0]
            read, write = (lambda: self.connection.recv(256)), self.connection.sendall
        else:
            read, write = (lambda: os.read(self.near, 256)), (lambda data: os.write(self.near, data))
        rest = b""
        try:
            while data := read():
                *lines, rest = (rest + data).split(b"\r")
                for line in lines:
                    if (reply := self.reply(line.strip().decode())) is not None:
                        write((reply + self.ending).encode())
        except OSError:
            return

    def reply(self, command):
        if not command.startswith(f"${self.address}"):
            return None
        self.received.append((time.monotonic(), command[3:]))
        letter, *parts = command[3:].split(" ")
        if letter == "I":
            numbers = [self.nominal() + self.shown_K, self.nominal()] + [0.0] * (2 * self.pairs - 2)
            return " ".join(f"{number:06.1f}" for number in numbers) + f" {self.bits}{self.after}"
        if letter == "E" and len(parts) == self.pairs + 1 and len(parts[-1]) == len(self.bits):
            self.began, self.since = self.nominal(), time.monotonic()
            self.wanted, self.bits = float(parts[0]), parts[-1]
            return "0"
        if letter == "U":
            return self.set_slopes(parts)
        if letter == "F" and self.faults:
            return "00"
        return f"'{command}' is an unknown command."

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

    def close(self):
        if self.server:
            self.connection.close()
            self.server.close()
        else:
            os.close(self.near)
            os.close(self.far)


@pytest.fixture
def chamber(monkeypatch):
    monkeypatch.setattr(workers, "_LEAST_WALL_S", 2.0)
    made = []

    def make(**of):
        made.append(Chamber(**of))
        return made[-1]

    yield make
    for each in made:
        each.close()


# what is there, and what a campaign gives of it; the outputs that are on while it runs
ROWS = {
    "Vc3 7060": ({}, {"gradient": "needed"}, {1}),
    "Vc3 7060 over TCP": ({"tcp": True, "ending": "\r\n"}, {"gradient": "needed", "values": 7, "outputs": 32}, {1}),
    "VT3 7034": ({"pairs": 5, "ending": "\r\n", "slopes": "pair"}, {}, {1}),
    "VT4002": ({"pairs": 5, "bits": 16, "ending": "\r\n", "slopes": "pair"}, {"terminator": "CRLF"}, {1, 3}),
    "VC4060": ({"pairs": 1, "bits": 16, "address": "00", "after": "Z", "slopes": "pair"}, {"address": 0}, {1, 3}),
    "thermo_comm": (
        {"pairs": 1, "bits": 16, "address": "00", "ending": "\r\n", "slopes": "outputs", "faults": True},
        {"address": 0, "gradient": "outputs", "alarms": True, "start": (1, 3)},
        {1, 3},
    ),
}


def given(port, **values):
    return settings("voetsch-vt4004", port=port, **{"address": 1, "alarms": False, "timeout_s": 0.5, **values})


@pytest.mark.parametrize(("there", "campaign", "on"), ROWS.values(), ids=ROWS)
def test_each_is_driven_by_what_a_campaign_gives(chamber, there, campaign, on):
    made = chamber(**there)
    driver = Driver(given(made.port, **campaign), Clock(), SetPointLimits(made.port, -20.0, 60.0))
    for set_degC in (25.0, -7.5):
        driver.gradient(10.0, rising=set_degC > 20.0)
        driver.gradient(0.0)
        driver.set_point(set_degC)
        assert made.wanted == set_degC
        assert {index for index, bit in enumerate(made.bits) if bit == "1"} == on
        reading = driver.read()
        assert (reading.values["chamber_set_degC"], reading.values["chamber_on"], reading.note) == (set_degC, 1.0, None)
    driver.stop()
    assert "1" not in made.bits
    driver.close()


def test_another_layout_than_the_one_given_or_seen_is_no_state(chamber):
    made = chamber()
    for values in ({"outputs": 16}, {"values": 5}, {}):
        driver = Driver(given(made.port, **values), Clock(), SetPointLimits(made.port, -20.0, 60.0))
        if not values:
            driver.read()
            made.bits += "0"
        with pytest.raises(InstrumentError):
            driver.read()
        driver.close()
    for values in ({"values": 3, "other_values": (1.0,)}, {"values": 9, "readings": 16}):
        with pytest.raises(ValidationError):
            Settings(kind="voetsch-vt4004", port="/dev/a", **values)


class Night:
    """A run with such a chamber beside the simulated multiplexer and phone; ``stop_s`` is when somebody stops it."""

    def __init__(self, campaign_file, tmp_path, made, steps, stop_s=None, chamber=None, **safety):
        changes = {f"safety.{key}": value for key, value in {"ambient_lost_s": 1e5, **safety}.items()}
        loaded = load_campaign(campaign_file(steps, changes), ports=False)
        self.events, self.stopped, self.stop_s = [], None, stop_s
        self.output = str(tmp_path / "trace.csv")
        with simulated_laboratory(loaded, Clock(SPEED)) as there:
            laboratory = there.loaded.campaign.laboratory
            mine = laboratory.instruments.model_copy(
                update={"chamber": given(made.port, period_s=20.0, **(chamber or {}))}
            )
            campaign = there.loaded.campaign.model_copy(
                update={"laboratory": laboratory.model_copy(update={"instruments": mine})}
            )
            self.job = Job(there.loaded._replace(campaign=campaign), self.output, SPEED, True, there.environment)
            began_s = time.monotonic()
            self.outcome = collect(
                self.job, Supervision(self.update, self.event, lambda: self.stopped, lambda: False)
            ).outcome
            self.took_s = time.monotonic() - began_s
        self.complete = load_trace(self.output).notes["complete"]

    def update(self, run):
        if not os.path.exists(kept := os.path.join(os.path.dirname(self.output), "kept")):
            os.link(run.journal.path, kept)
        if self.stop_s is not None and run.clock.now_s() > self.stop_s:
            self.stopped = "stopped by SIGINT"

    def event(self, at_s, text):
        self.events.append(text)


def minutes(*steps):
    return [dict(zip(("duration_min", "chamber_degC", "gradient_K_min"), step)) for step in steps]


@in_real_time
def test_a_set_point_does_not_wait_for_a_gradient_that_is_refused(chamber, campaign_file, tmp_path):
    made = chamber(slopes="refused")
    night = Night(campaign_file, tmp_path, made, minutes((4, 35.0, 2.0), (2, 30.0)))
    assert [degC for _, degC in made.set_points()] == [35.0, 30.0, 20.0]
    assert (night.outcome.ending, night.outcome.safe) == (Ending.DEVIATED, True)
    assert night.took_s < 25.0
    assert night.complete.startswith("no: ")
    assert "gradient 2.0 K/min" in night.complete
    assert not os.path.exists(night.output + ".part")


@in_real_time
def test_a_gradient_is_followed_and_lifted_at_the_end(chamber, campaign_file, tmp_path):
    made = chamber(speed=SPEED)
    night = Night(campaign_file, tmp_path, made, minutes((8, 35.0, 2.5)), chamber={"gradient": "needed"}, confirm_s=60)
    assert (night.outcome.ending, night.complete) == (Ending.FINISHED, "yes")
    assert (made.slope, made.wanted) == (0.0, 20.0)


WAYS = {
    "go-on": (Ending.DEVIATED, None),
    "wait": (Ending.LIMIT, None),
    "end": (Ending.LIMIT, None),
    "stopped": (Ending.STOPPED, 480.0),
}


@in_real_time
@pytest.mark.parametrize("way", WAYS)
def test_what_a_chamber_reports_instead_is_said_and_the_run_ends(chamber, campaign_file, tmp_path, monkeypatch, way):
    """It shows 31.5 for 25, and never the safe set point either."""
    monkeypatch.setattr(run_module, "_SAFE_S", 2.0)
    monkeypatch.setattr(run_module, "_LONGEST_WAIT_S", 120.0)
    made = chamber()
    made.shown_K = 6.5
    ending, stop_s = WAYS[way]
    wanted = {"unconfirmed": way} if way in ("go-on", "wait", "end") else {}
    night = Night(campaign_file, tmp_path, made, minutes((10, 25.0)), stop_s, confirm_s=60, **wanted)
    (said,) = {text for text in night.events if "31.5" in text}
    assert "25.0 degC within 60 s" in said
    assert (night.outcome.ending, night.outcome.safe) == (ending, False)
    assert night.complete.startswith("no: ")
    assert night.took_s < 15.0
    rows = len(load_trace(night.output).time_s)
    assert (rows < 600) == (way in ("end", "stopped", "wait"))
    assert os.path.exists(night.output + ".part") == (way != "go-on")


@in_real_time
def test_a_program_waits_for_its_set_point_and_goes_on(chamber, campaign_file, tmp_path):
    made = chamber()
    made.shown_K = 6.5
    threading.Timer(540 / SPEED, lambda: setattr(made, "shown_K", 0.0)).start()
    night = Night(campaign_file, tmp_path, made, minutes((6, 25.0)), confirm_s=30, unconfirmed="wait")
    assert (night.outcome.ending, night.outcome.safe) == (Ending.DEVIATED, True)
    assert len(load_trace(night.output).time_s) > 420


def test_after_a_crash_the_gradient_is_lifted_at_an_even_pace_and_each_step_is_logged(chamber, tmp_path):
    made = chamber(slopes="pair")
    made.wanted, made.bits, made.slope, made.began = 50.0, "01" + "0" * 30, 6.0, 50.0
    log = tmp_path / "safety.log"
    dog = Watchdog(given(made.port), 20.0, True, str(log))
    process = subprocess.Popen(dog.argv, stdin=subprocess.PIPE)
    process.stdin.close()
    began_s = time.monotonic()
    assert process.wait(timeout=30) == 0
    assert (made.wanted, made.slope) == (20.0, 0.0)
    assert len(made.set_points()) <= 2 + (time.monotonic() - began_s)
    steps = log.read_text()
    assert re.search(r"set point 20\.0 degC is sent", steps)
    assert re.search(r"gradient 0 K/min is sent", steps)
    assert re.search(r"confirmed the set point 20\.0 degC$", steps)


def test_after_a_crash_a_chamber_that_refuses_gradients_is_safe_all_the_same(chamber, tmp_path):
    made = chamber(slopes="refused")
    made.wanted, made.bits = 50.0, "01" + "0" * 30
    process = subprocess.Popen(
        Watchdog(given(made.port), 20.0, True, str(tmp_path / "log")).argv, stdin=subprocess.PIPE
    )
    process.stdin.close()
    assert process.wait(timeout=30) == 0
    assert made.wanted == 20.0
    assert len(made.received) < 60


@in_real_time
def test_a_run_whose_program_is_over_keeps_its_deviation_over_a_resumption(chamber, campaign_file, tmp_path):
    made = chamber(slopes="refused")
    night = Night(campaign_file, tmp_path, made, minutes((4, 25.0, 2.0)))
    os.rename(tmp_path / "kept", night.output + ".part")
    again = resume(night.job, Supervision(night.update, night.event, lambda: None, lambda: False)).outcome
    assert (again.ending, again.why) == (Ending.DEVIATED, night.outcome.why)
