"""A simulated night in which links are pulled, the phone starts anew and the collector is killed, at drawn times.

The laboratory lives in this process and goes on while the collector, one of its own, is gone.
"""

import os
import random
import signal
import subprocess
import sys
import threading
import time
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import yaml

from ambient_trainer.data.trace import load_trace
from ambient_trainer.laboratory.campaign import load_campaign
from ambient_trainer.laboratory.journal import read_journal
from ambient_trainer.laboratory.messages import CLOCK_OFFSET, DEVICE, MULTIPLEXER, Clock, Sample
from ambient_trainer.laboratory.simulation import simulated_laboratory

SPEED = 60.0
SAFE_DEGC = 20.0
COLLECTOR = Path(__file__).with_name("collector.py")


class Collector:
    """The process, and what it has acknowledged."""

    def __init__(self, path, output, environment, *words, speed=SPEED):
        self.acknowledged = 0
        self.lines = []
        self.process = subprocess.Popen(
            [sys.executable, str(COLLECTOR), str(path), str(output), str(speed), *words],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            env={**os.environ, **environment},
        )
        self.reader = threading.Thread(target=self._read)
        self.reader.start()

    def _read(self):
        for line in self.process.stdout:
            self.lines.append(line.rstrip())
            if line.startswith("disk "):
                self.acknowledged = int(line.split()[1])

    def kill(self, number=signal.SIGKILL):
        self.process.send_signal(number)
        return self.wait()

    def wait(self):
        status = self.process.wait(timeout=120)
        self.reader.join()
        self.process.stdout.close()
        return status


class Outages:
    """Who was away when, in the machine's calendar."""

    def __init__(self):
        self.of = {"multiplexer": [], "phone": []}

    def within(self, name, began_unix_s, margin_s):
        """Spans of the run's time in which nothing can have come from ``name``."""
        spans = [((a - began_unix_s) * SPEED, (b - began_unix_s) * SPEED) for a, b in self.of[name]]
        return [(a + margin_s, b - margin_s) for a, b in spans if b - a > 2 * margin_s]


def _mute(there, muted):
    there.chamber.muted = muted


def _away(there, what, duration_s, outages):
    """Take something away for a while of the laboratory's time."""
    deeds = {
        "chamber": (there.chamber.unplug, there.chamber.plug),
        "chamber's answers": (lambda: _mute(there, True), lambda: _mute(there, False)),
        "multiplexer": (there.multiplexer.unplug, there.multiplexer.plug),
        "phone": (there.phone.pull_cable, there.phone.plug_cable),
        "phone's power": (there.phone.reboot, there.phone.plug_cable),
    }
    take, give = deeds[what]
    take()
    began_unix_s = time.time()
    time.sleep(duration_s / SPEED)
    for name, spans in outages.of.items():
        if what.startswith(name):
            spans.append((began_unix_s, time.time()))
    give()


def _samples(path):
    return [entry for entry in read_journal(str(path)).entries if isinstance(entry, Sample)]


def _whole_lines(path):
    data = Path(path).read_bytes()
    return data[: data.rfind(b"\n") + 1]


def _campaign(there, tmp_path):
    """The rehearsed campaign as a file that a process of its own reads."""
    data = there.loaded.campaign.model_dump(mode="json", exclude_none=True)
    path = tmp_path / "with_ports.yaml"
    path.write_text(yaml.safe_dump(data))
    return path


def _night(campaign_file, tmp_path, seed, kills, faults_between):
    steps = [
        {"duration_min": 6, "chamber_degC": 30},
        {"duration_min": 6, "chamber_degC": 30, "load": ["cpu_50"]},
        {"duration_min": 8, "chamber_degC": 10, "gradient_K_min": 5},
    ]
    loaded = load_campaign(
        campaign_file(steps, {"safety.ambient_lost_s": 600.0, "safety.confirm_s": 600.0}), ports=False
    )
    draw = random.Random(seed)
    outages = Outages()
    trace, journal = tmp_path / "trace.csv", tmp_path / "trace.csv.part"
    kept = []
    with simulated_laboratory(loaded, Clock(SPEED), seed) as there:
        path = _campaign(there, tmp_path)
        collector = Collector(path, trace, there.environment)
        while not journal.exists():
            time.sleep(0.01)
        os.link(journal, tmp_path / "kept")  # the collector removes its own at the end
        known = 0
        for life in range(kills):
            _live_through(collector, there, draw, faults_between, outages)
            assert collector.process.poll() is None, "\n".join(collector.lines)
            collector.kill()
            kept.append(_whole_lines(journal))
            assert len(_samples(journal)) >= known + collector.acknowledged
            if life == 0:
                _until(lambda: there.chamber.held_degC == SAFE_DEGC)  # nobody resumes it, and it is safe all the same
            known = len(_samples(journal))
            collector = Collector(path, trace, there.environment, "resume")
        _live_through(collector, there, draw, faults_between, outages)
        assert collector.wait() == 0, collector.lines
        assert collector.lines[-1] == "end finished True"
        assert there.chamber.held_degC == SAFE_DEGC
    kept.append(_whole_lines(tmp_path / "kept"))
    return trace, tmp_path / "kept", kept, outages


def _live_through(collector, there, draw, count, outages):
    """Some of the time undisturbed, then one thing after the other away."""
    _until(lambda: collector.acknowledged)  # a loaded machine takes its time to start it
    time.sleep(draw.uniform(1.0, 1.5))
    for what in draw.sample(["chamber", "chamber's answers", "multiplexer", "phone", "phone's power"], count):
        _away(there, what, draw.uniform(20.0, 70.0), outages)
        time.sleep(draw.uniform(0.1, 0.7))


def _until(condition):
    deadline = time.monotonic() + 100.0
    while not condition():
        assert time.monotonic() < deadline, "it never came to that"
        time.sleep(0.02)


def _check(trace_path, journal, kept, outages):
    for earlier, later in pairwise(kept):
        assert later.startswith(earlier), "what was acknowledged was changed"
    trace = load_trace(str(trace_path))
    record = read_journal(str(journal))
    assert trace.notes["complete"] == "yes"
    usb, ambient = trace.column("usb_degC"), trace.column("ambient_degC")
    # every sample whose time is known stands in its second, by a count of its own
    for source, values in ((DEVICE, usb), (MULTIPLEXER, ambient)):
        seconds = {
            int(entry.at_s + 1e-6)
            for entry in record.entries
            if isinstance(entry, Sample) and entry.source == source and entry.answered_s - entry.asked_s <= 2.0
        }
        assert set(np.flatnonzero(np.isfinite(values))) == {second for second in seconds if second < len(values)}
    for name, column in (("phone", usb), ("multiplexer", ambient)):
        spans = outages.within(name, record.head.began_unix_s, margin_s=3.0)
        for begin_s, end_s in spans:
            assert np.isnan(column[int(begin_s) : int(end_s)]).all(), f"{name} was away"
    load = trace.column("cpu_load_frac")
    assert np.nanmax(load) == 0.5
    assert len(trace.time_s) > 1200  # the program's 20 minutes, and the gaps


DAY_S = 86400.0
KILLS = int(os.environ.get("AMBIENT_KILLS", "4"))


@pytest.mark.slow
@pytest.mark.timeout(300 + 20 * KILLS)
def test_killed_at_any_moment_it_goes_on_with_the_last_scan_and_the_right_time(campaign_file, tmp_path):
    """``AMBIENT_KILLS=100`` kills it at a hundred drawn moments; the calendar is stepped by a day and back."""
    steps = [{"duration_min": 1, "chamber_degC": degC, "gradient_K_min": 5} for degC in (30, 10, 25)] * 40
    patient = {"instruments.chamber.period_s": 2, "instruments.multiplexer.timeout_s": 20, "device.timeout_s": 20}
    loaded = load_campaign(campaign_file(steps, patient), ports=False)
    draw, speed, scans = random.Random(4), 2.0, []
    trace, journal = tmp_path / "trace.csv", tmp_path / "trace.csv.part"
    with simulated_laboratory(loaded, Clock(speed), 4) as there:
        scan = there.multiplexer._scan
        there.multiplexer._scan = lambda: (scans.append(0), scan())[1]
        path, words, known = _campaign(there, tmp_path), (), 0
        for life in range(KILLS):
            stepped = {"STEPPED_S": str(draw.choice((-DAY_S, 0.0, DAY_S)))}
            scans.clear()
            collector = Collector(path, trace, {**there.environment, **stepped}, *words, speed=speed)
            _until(lambda collector=collector: collector.acknowledged or collector.process.poll() is not None)
            time.sleep(draw.uniform(0.0, 1.5))
            assert collector.process.poll() is None, "\n".join(collector.lines)
            collector.kill()
            found, words = [each for each in _samples(journal) if each.source == MULTIPLEXER], ("resume",)
            tried = 2 if life == 0 else 0  # before a run begins
            assert len(scans) - tried - (len(found) - known) <= 1, "the last scan at most"
            known = len(found)
        collector = Collector(path, trace, there.environment, "resume", speed=speed)
        _until(lambda: collector.acknowledged)
        collector.process.send_signal(signal.SIGTERM)
        assert collector.wait() == 0, collector.lines
        assert collector.lines[-1] == "end stopped True"
        assert there.chamber.held_degC == SAFE_DEGC
    samples = _samples(journal)
    assert len({(entry.source, entry.asked_s) for entry in samples}) == len(samples), "none stands twice"
    # the phone's uptime goes on whatever happens here: what it is ahead of the run's time stays, to a period
    ahead_s = [entry.values[CLOCK_OFFSET] for entry in samples if entry.source == DEVICE]
    assert max(ahead_s) - min(ahead_s) < 1.0
    assert set(np.diff(load_trace(str(trace)).time_s)) == {1.0}


@pytest.mark.slow
def test_a_night_with_many(campaign_file, tmp_path):
    _check(*_night(campaign_file, tmp_path, seed=10, kills=2, faults_between=3))


def test_sigterm_ends_it_safely_even_with_the_chamber_away(campaign_file, tmp_path):
    """The set point is sent until the chamber confirms it: the process does not leave before."""
    loaded = load_campaign(campaign_file([{"duration_min": 60, "chamber_degC": 40}]), ports=False)
    with simulated_laboratory(loaded, Clock(SPEED), 2) as there:
        collector = Collector(_campaign(there, tmp_path), tmp_path / "t.csv", there.environment)
        _until(lambda: there.chamber.held_degC == 40.0)
        there.chamber.unplug()
        collector.process.send_signal(signal.SIGTERM)
        time.sleep(1.0)
        assert collector.process.poll() is None
        there.chamber.plug()
        assert collector.wait() == 0
        assert there.chamber.held_degC == SAFE_DEGC
    assert collector.lines[-2].endswith(" stopped")
    assert collector.lines[-1] == "end stopped True"
