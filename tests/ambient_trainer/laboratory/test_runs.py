"""Whole runs in the simulated laboratory, in fast time: how they end, and what they leave."""

import os
import re
import threading
from pathlib import Path

import numpy as np
import pytest

from ambient_model.faults import Refused
from ambient_trainer.data.trace import load_trace
from ambient_trainer.laboratory.campaign import load_campaign
from ambient_trainer.laboratory.clock import Clock
from ambient_trainer.laboratory.collect import Job, collect, resume
from ambient_trainer.laboratory.device.device_under_test import DeviceUnderTest
from ambient_trainer.laboratory.run import Ending, Supervision
from ambient_trainer.laboratory.simulation.laboratory import simulated_laboratory

SPEED = 150.0


class Recorder:
    """A monitor that keeps the events, and does something when the run's time has come."""

    def __init__(self, deeds=()):
        self.events = []
        self.deeds = list(deeds)
        self.stop = None
        self.held = []

    def update(self, run):
        while self.deeds and run.timebase.now_s() >= self.deeds[0][0]:
            self.deeds.pop(0)[1](self)

    def event(self, at_s, text):
        self.events.append(text)

    @property
    def supervision(self):
        return Supervision(self, lambda: self.stop, lambda: False)


class Night:
    """A campaign in a simulated laboratory."""

    def __init__(self, path, output):
        self.loaded = load_campaign(path, ports=False)
        self.output = str(output)

    def run(self, deeds=(), work=collect, giving_up=False):
        clock = Clock(SPEED)
        with simulated_laboratory(self.loaded, clock, seed=3) as there:
            recorder = Recorder([(at_s, lambda recorder, deed=deed: deed(there, recorder)) for at_s, deed in deeds])
            job = Job(there.loaded, self.output, clock, True, there.environment)
            self.collected = work(
                job, recorder.supervision._replace(giving_up=lambda: giving_up and bool(recorder.stop))
            )
            self.held_degC = there.chamber.held_degC
            self.does = (Path(there.phone.root) / "activity").read_text().strip()
        return recorder

    @property
    def trace(self):
        return load_trace(self.output)


def minutes(*steps):
    return [dict(zip(("duration_min", "chamber_degC", "load"), step)) for step in steps]


@pytest.fixture
def night(campaign_file, tmp_path):
    def make(steps, changes=None, **further):
        # a machine that is loaded stalls for some of a fast clock's minutes
        changes = {"safety.ambient_lost_s": 1200, **(changes or {})}
        return Night(campaign_file(steps, changes, **further), tmp_path / "trace.csv")

    return make


def part(night):
    return Path(f"{night.output}.part")


def test_a_run_leaves_a_trace_and_a_safe_chamber(night):
    lab = night(minutes((4, 25), (4, 25, ["cpu_100"]), (2, 22)), before=minutes((2, 20)))
    lab.run()
    assert lab.collected.outcome.ending is Ending.FINISHED
    assert lab.held_degC == 20.0
    assert not part(lab).exists()
    trace = lab.trace
    assert np.array_equal(trace.time_s, np.arange(600.0))
    for name in ("soc_degC", "usb_degC", "ambient_degC"):
        assert np.isfinite(trace.column(name)).mean() > 0.5
    load = trace.column("cpu_load_frac")
    assert (load[300:460] == 1.0).all()
    assert (load[20:220] == 0.02).all()
    assert np.nanmean(trace.column("soc_degC")[400:480]) > np.nanmean(trace.column("soc_degC")[100:240]) + 20.0
    assert trace.notes["simulated"] == "yes"
    assert trace.notes["complete"] == "yes"
    assert trace.notes["campaign_sha256"] == lab.loaded.sha256
    assert trace.notes["multiplexer"].startswith("HEWLETT-PACKARD 34970A")
    assert trace.notes["device_clock"].startswith("uptime 50")
    beside = load_trace(lab.output.replace(".csv", ".laboratory.csv"))
    assert beside.time_s[0] < -100.0
    set_degC = beside.column("chamber_set_degC")
    assert set(set_degC[np.isfinite(set_degC)]) == {20.0, 25.0, 22.0}
    spread = np.stack([beside.column(f"probe_air{k}_degC") for k in range(1, 5)])
    np.testing.assert_allclose(
        np.nanmean(np.round(spread.mean(axis=0), 4)), np.nanmean(beside.column("probe_air1_degC")), atol=0.3
    )


def test_a_stop_comes_to_safety_first_and_goes_on_later(night):
    def stop(there, recorder):
        recorder.held.append(there.chamber.held_degC)
        recorder.stop = "stopped by SIGINT"

    lab = night(minutes((3, 25), (6, 30, ["charging"]), (1, 25)))
    recorder = lab.run([(480.0, stop)])
    assert (recorder.held, lab.held_degC) == ([30.0], 20.0)
    assert recorder.events[-1] == "stopped by SIGINT"
    assert lab.collected.outcome.ending is Ending.STOPPED
    first = lab.trace
    assert first.notes["complete"] == "no: stopped by SIGINT"
    assert 480 <= len(first.time_s) < 600
    kept = part(lab).read_bytes()

    lab.run(work=resume)
    assert lab.collected.outcome.ending is Ending.FINISHED
    second = lab.trace
    count = len(first.time_s)
    assert np.array_equal(second.column("soc_degC")[: count - 1], first.column("soc_degC")[: count - 1], equal_nan=True)
    charging = second.column("charging_on")
    assert charging[-200] == 1.0
    assert np.isnan(charging[count:]).any()
    # six minutes of the program, whatever the time in between
    assert abs(np.nansum(charging == 1.0) - 360.0) < 150.0
    assert len(second.time_s) > 600
    assert b"resumed after" not in kept
    assert lab.held_degC == 20.0


@pytest.mark.parametrize(
    ("deed", "why"),
    [
        (lambda there, recorder: there.multiplexer.unplug(), r"ambient: no probe answered for 1\d\d s"),
        (
            lambda there, recorder: [
                there.multiplexer.probes[channel].__setattr__("open", True) for channel in (101, 102, 103)
            ],
            r"ambient: no probe answered for 1\d\d s",
        ),
    ],
)
def test_probes_that_are_lost_end_the_run_safely(night, deed, why):
    lab = night(minutes((20, 40)), {"safety.ambient_lost_s": 120})
    lab.run([(60.0, deed)])
    assert lab.collected.outcome.ending is Ending.LIMIT
    assert re.fullmatch(why, lab.collected.outcome.why)
    assert lab.held_degC == 20.0
    assert lab.trace.notes["complete"].startswith("no: ambient: ")


def test_a_hot_device_ends_the_run_safely(night):
    lab = night(minutes((2, 30), (20, 30, ["cpu_100"])), {"safety.device_high_degC": {"soc_degC": 60.0}})
    lab.run()
    assert lab.collected.outcome.ending is Ending.LIMIT
    assert lab.collected.outcome.why.startswith("device: soc_degC is 6")
    assert lab.held_degC == 20.0
    assert lab.does == "idle"


def test_an_alarm_stops_the_chamber_and_not_the_logging(night):
    lab = night(minutes((3, 40), (4, 45, ["cpu_100"])))

    def acknowledge(there, recorder):
        there.chamber.repair()
        there.chamber.answer("Q")

    recorder = lab.run(
        [
            (60.0, lambda there, recorder: there.chamber.raise_alarm(7, "overtemperature")),
            (150.0, acknowledge),
            (300.0, lambda there, recorder: recorder.held.append(there.chamber.held_degC)),
        ]
    )
    assert recorder.held == [None], "what had an alarm is started by people"
    assert lab.collected.outcome.ending is Ending.FINISHED
    assert lab.collected.outcome.alarm == "07 overtemperature"
    assert lab.held_degC is None
    assert (
        "the chamber raised an alarm (07 overtemperature): it was stopped, and the logging goes on" in recorder.events
    )
    assert len(lab.trace.time_s) == 420
    assert np.isfinite(lab.trace.column("ambient_degC")[300:]).sum() > 60
    assert np.nanmax(lab.trace.column("cpu_load_frac")) == 0.02


def test_a_rebooted_phone_goes_on_with_what_it_did(night):
    lab = night(minutes((2, 20), (10, 20, ["cpu_100"])))

    def reboot(there, recorder):
        there.phone.reboot()
        threading.Timer(60.0 / SPEED, there.phone.plug_cable).start()

    recorder = lab.run([(240.0, reboot)])
    assert lab.collected.outcome.ending is Ending.FINISHED
    assert "device: was started anew" in recorder.events
    load = lab.trace.column("cpu_load_frac")
    away = np.flatnonzero(np.isnan(load[130:])) + 130
    assert away[0] > 235
    assert load[-60:].tolist() == [1.0] * 60
    assert np.isnan(lab.trace.column("soc_degC")[235:]).sum() > 30


def test_an_error_in_the_program_itself_comes_to_safety_first(night, monkeypatch):
    def broken(*_):
        raise ZeroDivisionError("a mistake")

    lab = night(minutes((20, 40)))
    recorder = lab.run([(60.0, lambda there, recorder: monkeypatch.setattr(DeviceUnderTest, "read", broken))])
    assert lab.collected.outcome.ending is Ending.FAILED
    assert lab.collected.outcome.why == "ZeroDivisionError: a mistake"
    assert recorder.events[-1] == "ZeroDivisionError: a mistake"
    assert lab.held_degC == 20.0


def test_a_second_ctrl_c_does_not_wait_for_a_chamber_that_is_away(night):
    def leave(there, recorder):
        there.chamber.unplug()
        recorder.stop = "stopped by SIGINT"

    lab = night(minutes((20, 40)))
    lab.run([(30.0, leave)], giving_up=True)
    assert (lab.collected.outcome.ending, lab.collected.outcome.safe) == (Ending.STOPPED, False)


def test_a_run_that_only_lacks_its_trace_is_brought_to_its_end(night, tmp_path):
    lab = night(minutes((1, 22)))
    lab.run([(5.0, lambda there, recorder: os.link(part(lab), tmp_path / "kept"))])
    whole = Path(lab.output).read_bytes()
    os.rename(tmp_path / "kept", part(lab))
    os.unlink(lab.output)
    recorder = lab.run(work=resume)
    assert recorder.events == []
    assert lab.held_degC is None, "nothing was moved"
    assert Path(lab.output).read_bytes() == whole
    assert not part(lab).exists()


def test_a_thermometer_that_switches_itself_off_ends_nothing(night):
    link = {"kind": "greisinger-easybus", "port": "/dev/ttyUSB2", "period_s": 2}
    lab = night(minutes((10, 22)), {"instruments.thermometer": link})
    recorder = lab.run(
        [
            (60.0, lambda there, recorder: there.thermometer.switch_off()),
            (140.0, lambda there, recorder: there.thermometer.switch_on()),
        ]
    )
    assert lab.collected.outcome.ending is Ending.FINISHED
    assert any(text.startswith("thermometer on ") and text.endswith("switch it on") for text in recorder.events)
    assert any(text.startswith("thermometer is back after ") for text in recorder.events)
    beside = load_trace(lab.output.replace(".csv", ".laboratory.csv"))
    reading = beside.column("thermometer_degC")
    assert np.nanmean(reading) == pytest.approx(np.nanmean(lab.trace.reference), abs=1.0)
    assert "thermometer" in lab.trace.notes


def test_a_chamber_in_alarm_is_not_begun_with(night):
    lab = night(minutes((2, 22)))
    with simulated_laboratory(lab.loaded, clock := Clock(SPEED)) as there:
        there.chamber.raise_alarm(7, "overtemperature")
        job = Job(there.loaded, lab.output, clock, True, there.environment)
        with pytest.raises(
            Refused, match="expected no alarm, got 07 overtemperature; see to it, and acknowledge it at"
        ):
            collect(job, Recorder().supervision)


def test_a_monitor_that_fails_is_no_reason_to_stop(night):
    class Broken(Recorder):
        def update(self, *_):
            raise BrokenPipeError

        event = update

    lab = night(minutes((2, 22)))
    with simulated_laboratory(lab.loaded, clock := Clock(SPEED)) as there:
        job = Job(there.loaded, lab.output, clock, True, there.environment)
        outcome = collect(job, Broken().supervision).outcome
    assert outcome.ending is Ending.FINISHED


def test_what_is_not_ready_is_named_and_nothing_moves(night):
    lab = night(minutes((2, 22)))
    with simulated_laboratory(lab.loaded, clock := Clock(SPEED)) as there:
        there.multiplexer.probes[102].open = True
        there.phone.pull_cable()
        there.chamber.unplug()
        job = Job(there.loaded, lab.output, clock, True, there.environment)
        with pytest.raises(Refused) as refused:
            collect(job, Recorder().supervision)
        assert there.chamber.held_degC is None
    text = str(refused.value)
    assert text.startswith("the laboratory is not ready, and nothing was moved: 3 faults\n")
    assert "no reading of air2; connect it, or take it out of 'laboratory.ambient.probes'" in text
    assert "(error: no devices/emulators found)" in text
    assert "chamber on " in text
    assert not part(lab).exists()


def test_another_campaign_does_not_go_on_with_it(night, campaign_file):
    lab = night(minutes((2, 22)))
    lab.run([(30.0, lambda there, recorder: setattr(recorder, "stop", "enough"))])
    other = Night(campaign_file(minutes((2, 23))), lab.output)
    with pytest.raises(
        Refused, match=r"holds a run of campaign 'night' as it was with SHA-256 .* give the one that it"
    ):
        other.run(work=resume)
    with pytest.raises(Refused, match="a run has begun here and not come to its end"):
        lab.run()


@pytest.mark.parametrize(
    ("steps", "changes", "message"),
    [
        (minutes((1, 20, ["dance"])), {"actions.dance": {"start": ":", "stop": ":", "signals": {}}}, "cannot do dance"),
        (minutes((1, 20, ["cpu_50", "charging"])), {}, "cannot do cpu_50 and charging; it does one at a time of"),
        (
            minutes((1, 20)),
            {"device.zones.skin-therm": "my-skin_degC"},
            "the simulated phone has no my-skin_degC; it has",
        ),
    ],
)
def test_what_the_simulated_phone_lacks_is_refused(night, steps, changes, message):
    with pytest.raises(Refused, match=message):
        night(steps, changes).run()
