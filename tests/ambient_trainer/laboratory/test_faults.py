"""A simulated night in which the collector is killed, at drawn times, or ended.

The laboratory lives in this process and goes on while the collector, one of its own, is gone.
"""

import os
import random
import signal
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
import yaml

from ambient_trainer.data.trace import load_trace
from ambient_trainer.laboratory import watchdog
from ambient_trainer.laboratory.campaign import load_campaign
from ambient_trainer.laboratory.journal import read_journal
from ambient_trainer.laboratory.messages import CLOCK_OFFSET, DEVICE, MULTIPLEXER, Clock, Sample
from ambient_trainer.laboratory.simulation import simulated_laboratory
from processes import under

SPEED = 60.0
SAFE_DEGC = 20.0


class Collector:
    """The process, and what it has acknowledged."""

    def __init__(self, spawn, path, output, environment, *words, speed=SPEED):
        self.acknowledged, self.lines = 0, []
        call = [sys.executable, Path(__file__).with_name("collector.py"), path, output, speed, *words]
        self.process = spawn(call, env={**os.environ, **environment})
        self.reader = threading.Thread(target=self._read)
        self.reader.start()

    def _read(self):
        for line in self.process.stdout:
            self.lines.append(line.rstrip())
            if line.startswith("disk "):
                self.acknowledged = int(line.split()[1])

    def wait(self):
        status = self.process.wait(timeout=120)
        self.reader.join()
        return status


def _campaign(there, tmp_path):
    """The rehearsed campaign as a file that a process of its own reads."""
    data = there.loaded.campaign.model_dump(mode="json", exclude_none=True)
    path = tmp_path / "with_ports.yaml"
    path.write_text(yaml.safe_dump(data))
    return path


DAY_S = 86400.0
KILLS = int(os.environ.get("AMBIENT_KILLS", "4"))


@pytest.mark.slow
@pytest.mark.timeout(300 + 20 * KILLS)
def test_killed_at_any_moment_it_goes_on_with_the_last_scan_and_the_right_time(campaign_file, tmp_path, until, spawn):
    """``AMBIENT_KILLS=100`` kills it at a hundred drawn moments; the calendar is stepped by a day and back."""
    steps = [{"duration_min": 1, "chamber_degC": degC, "gradient_K_min": 5} for degC in (30, 10, 25)] * 40
    patient = {"instruments.chamber.period_s": 2, "instruments.multiplexer.timeout_s": 20, "device.timeout_s": 20}
    loaded = load_campaign(campaign_file(steps, patient), ports=False)
    draw, speed, scans = random.Random(4), 2.0, []
    trace, journal, kept = tmp_path / "trace.csv", tmp_path / "trace.csv.part", b""
    with simulated_laboratory(loaded, Clock(speed), 4) as there:
        scan = there.multiplexer._scan
        there.multiplexer._scan = lambda: (scans.append(0), scan())[1]
        path, words, known = _campaign(there, tmp_path), (), 0
        for life in range(KILLS):
            stepped = {"STEPPED_S": str(draw.choice((-DAY_S, 0.0, DAY_S)))}
            scans.clear()
            collector = Collector(spawn, path, trace, {**there.environment, **stepped}, *words, speed=speed)
            until(lambda its=collector: its.acknowledged or its.process.poll() is not None, seconds=100.0)
            time.sleep(draw.uniform(0.0, 1.5))
            assert collector.process.poll() is None, "\n".join(collector.lines)
            collector.process.kill()
            collector.wait()
            data = journal.read_bytes()
            assert data.startswith(kept), "what was acknowledged was changed"
            kept = data[: data.rfind(b"\n") + 1]
            samples, words = read_journal(str(journal)).of(Sample), ("resume",)
            found = [each for each in samples if each.source == MULTIPLEXER]
            tried = 2 if life == 0 else 0  # before a run begins
            assert len(scans) - tried - (len(found) - known) <= 1, "the last scan at most"
            assert len(samples) >= collector.acknowledged
            known = len(found)
            if life == 0:
                until(lambda: there.chamber.held_degC == SAFE_DEGC)  # nobody resumes it, and it is safe all the same
        collector = Collector(spawn, path, trace, there.environment, "resume", speed=speed)
        until(lambda: collector.acknowledged, seconds=100.0)
        collector.process.send_signal(signal.SIGTERM)
        assert collector.wait() == 0, collector.lines
        assert collector.lines[-1] == "end stopped True"
        assert there.chamber.held_degC == SAFE_DEGC
    samples = read_journal(str(journal)).of(Sample)
    assert len({(entry.source, entry.asked_s) for entry in samples}) == len(samples), "none is duplicated"
    # the phone's uptime goes on whatever happens here: what it is ahead of the run's time stays, to a period
    ahead_s = [entry.values[CLOCK_OFFSET] for entry in samples if entry.source == DEVICE]
    assert max(ahead_s) - min(ahead_s) < 1.0
    assert set(np.diff(load_trace(str(trace)).time_s)) == {1.0}


def test_sigterm_ends_it_safely_even_with_the_chamber_away(campaign_file, tmp_path, until, spawn):
    """The set point is sent until the chamber confirms it: the process does not leave before."""
    loaded = load_campaign(campaign_file([{"duration_min": 60, "chamber_degC": 40}]), ports=False)
    with simulated_laboratory(loaded, Clock(SPEED), 2) as there:
        collector = Collector(spawn, _campaign(there, tmp_path), tmp_path / "t.csv", there.environment)
        until(lambda: there.chamber.held_degC == 40.0, seconds=100.0)
        below = under(collector.process.pid, "cmdline").items()
        os.kill(next(pid for pid, words in below if watchdog.__name__ in words), signal.SIGKILL)
        until(lambda: any("was started again" in line for line in collector.lines), seconds=30.0)
        there.chamber.unplug()
        collector.process.send_signal(signal.SIGTERM)
        time.sleep(1.0)
        assert collector.process.poll() is None
        there.chamber.plug()
        assert collector.wait() == 0
        assert there.chamber.held_degC == SAFE_DEGC
    assert collector.lines[-2].endswith(" stopped")
    assert collector.lines[-1] == "end stopped True"
