"""Whole runs in the simulated laboratory, in fast time: how they end, and what they leave."""

import errno
import itertools
import os
import re
import threading
import time
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest
import yaml

from ambient_model.faults import refuse
from ambient_trainer.data.trace import load_trace
from ambient_trainer.laboratory.collect import Job, laboratory_path, resume
from ambient_trainer.laboratory.device_under_test import DeviceUnderTest
from ambient_trainer.laboratory.report import problems_of
from ambient_trainer.laboratory.run import Ending
from ambient_trainer.simulator.scenario import scenario_path
from breaking import acknowledge, open_probe, pull_cable, raise_alarm
from refusals import refused

from .conftest import Night, in_real_time, minutes


@in_real_time
def test_a_run_leaves_a_trace_and_a_safe_chamber(night):
    lab = night(minutes((4, 25), (4, 25, ["cpu_100"]), (2, 22)), before=minutes((2, 20)))
    lab.run()
    assert (lab.outcome.ending, lab.held_degC, lab.part.exists()) == (Ending.FINISHED, 20.0, False)
    trace = lab.trace
    assert np.array_equal(trace.time_s, np.arange(600.0))
    for name in ("soc_degC", "usb_degC", "ambient_degC"):
        assert np.isfinite(trace.column(name)).mean() > 0.5
    load, soc_degC = trace.column("cpu_load_frac"), trace.column("soc_degC")
    assert (set(load[300:460]), set(load[20:220])) == ({1.0}, {0.02})
    assert np.nanmean(soc_degC[400:480]) > np.nanmean(soc_degC[100:240]) + 20.0
    assert (trace.notes["simulated"], trace.notes["complete"]) == ("yes", "yes")
    assert trace.notes["campaign_sha256"] == lab.loaded.sha256
    assert trace.notes["multiplexer"].startswith("HEWLETT-PACKARD 34970A")
    assert trace.notes["device_clock"].startswith("uptime 50")
    beside = load_trace(laboratory_path(lab.output))
    assert beside.time_s[0] < -100.0
    set_degC = beside.column("chamber_set_degC")
    assert set(set_degC[np.isfinite(set_degC)]) == {20.0, 25.0, 22.0}
    probes = np.stack([beside.column(f"probe_air{k}_degC") for k in range(1, 5)])
    assert np.nanmean(probes.mean(axis=0)) == pytest.approx(np.nanmean(probes[0]), abs=0.3)


LOST, HOT = {"safety.ambient_lost_s": 120}, {"safety.device_high_degC": {"soc_degC": 60.0}}
SILENT = "ambient: no probe answered for 1"


@pytest.mark.parametrize(
    ("safety", "deed", "why"),
    [
        (LOST, lambda there: there.multiplexer.unplug(), SILENT),
        (LOST, lambda there: [open_probe(there.multiplexer.probes[k]) for k in (101, 102, 103)], SILENT),
        (HOT, lambda there: None, "device: soc_degC is "),
    ],
)
def test_probes_that_are_lost_or_a_hot_device_end_the_run_safely(night, safety, deed, why):
    lab = night(minutes((2, 30), (20, 30, ["cpu_100"])), safety)
    lab.run([(60.0, deed)])
    assert (lab.outcome.ending, lab.held_degC, lab.activity) == (Ending.LIMIT, 20.0, "idle")
    assert lab.outcome.why.startswith(why)
    assert lab.trace.notes["complete"].startswith(f"no: {why}")


@in_real_time
def test_an_alarm_stops_the_chamber_and_not_the_logging(night):
    held = []
    lab = night(minutes((3, 40), (4, 45, ["cpu_100"])))
    events = lab.run(
        [
            (60.0, lambda there: raise_alarm(there.chamber, 7, "overtemperature")),
            (150.0, lambda there: acknowledge(there.chamber)),
            (300.0, lambda there: held.append(there.chamber.held_degC)),
        ]
    )
    assert held == [None], "after an alarm, people start the chamber"
    assert (lab.outcome.ending, lab.outcome.alarm, lab.held_degC) == (Ending.DEVIATED, "07 overtemperature", None)
    assert any("07 overtemperature" in text for text in events)
    assert len(lab.trace.time_s) == 420
    assert np.isfinite(lab.trace.column("ambient_degC")[300:]).sum() > 60
    assert np.nanmax(lab.trace.column("cpu_load_frac")) == 0.02


def test_a_run_that_waits_for_its_set_point_ends_with_its_program_after_an_alarm(night, monkeypatch):
    monkeypatch.setattr("ambient_trainer.laboratory.workers._LEAST_WALL_S", 0.0)
    lab = night(minutes((1, 30), (4, 35)), {"safety.unconfirmed": "wait", "safety.confirm_s": 60})
    deeds = {
        50.0: lambda there: there.chamber.unplug(),
        240.0: lambda there: (raise_alarm(there.chamber, 7, "hot"), there.chamber.plug()),
        900.0: lambda there: setattr(lab, "stop", "stuck"),
    }
    lab.run(deeds.items())
    assert (lab.outcome.ending, lab.outcome.alarm) == (Ending.DEVIATED, "07 hot")


def test_time_in_which_nothing_ran_does_not_count_as_time_in_the_step(night, monkeypatch):
    monkeypatch.setattr("ambient_trainer.laboratory.run._ASLEEP_S", 0.5)
    lab = night(minutes((2, 22)))
    lab.run([(30.0, lambda there: time.sleep(1.5))])
    assert (lab.outcome.ending, len(lab.trace.time_s) > 300) == (Ending.FINISHED, True)


def test_an_error_in_the_program_itself_comes_to_safety_first(night, monkeypatch):
    lab, broken = night(minutes((20, 40))), Mock(side_effect=ZeroDivisionError("a mistake"))
    events = lab.run([(60.0, lambda there: monkeypatch.setattr(DeviceUnderTest, "read", broken))])
    assert (lab.outcome.ending, lab.outcome.why, lab.held_degC) == (Ending.FAILED, "ZeroDivisionError: a mistake", 20.0)
    assert events[-1] == lab.outcome.why


def test_a_second_ctrl_c_does_not_wait_for_a_chamber_that_is_away(night):
    lab = night(minutes((20, 40)))
    leave = [lambda there: there.chamber.unplug(), lambda _: setattr(lab, "stop", "stopped by SIGINT")]
    lab.run([(30.0, deed) for deed in leave], giving_up=True)
    assert (lab.outcome.ending, lab.outcome.safe) == (Ending.STOPPED, False)


def test_a_run_that_only_lacks_its_trace_is_brought_to_its_end(night, tmp_path):
    lab = night(minutes((1, 22)))
    lab.run([(5.0, lambda there: os.link(lab.part, tmp_path / "kept"))])
    whole = Path(lab.output).read_bytes()
    os.rename(tmp_path / "kept", lab.part)
    os.unlink(lab.output)
    assert lab.run(work=resume) == []
    assert (lab.held_degC, lab.part.exists()) == (None, False), "nothing was moved"
    assert Path(lab.output).read_bytes() == whole


def test_a_monitor_that_fails_is_no_reason_to_stop(night):
    lab, broken = night(minutes((2, 22))), Mock(side_effect=BrokenPipeError)
    lab.run(monitor=broken, event=broken)
    assert lab.outcome.ending is Ending.FINISHED


def test_what_is_not_ready_is_named_and_nothing_moves(night):
    def prepare(there):
        open_probe(there.multiplexer.probes[102])
        pull_cable(there.phone)
        raise_alarm(there.chamber, 7, "overtemperature")

    lab = night(minutes((2, 22)))
    faults = [str(fault) for fault in refused(lab.run, before=prepare).faults]
    told = ("chamber on .*07 overtemperature", "multiplexer on .*air2", "device on .*no devices/emulators found")
    assert all(map(re.match, told, faults)), faults
    assert (len(faults), lab.held_degC, lab.part.exists()) == (3, None, False)


def test_a_stop_while_an_instrument_is_waited_for_moves_nothing(night, monkeypatch):
    lab, asked = night(minutes((2, 22))), threading.Event()
    monkeypatch.setattr(DeviceUnderTest, "identify", lambda _: asked.set() or threading.Event().wait())
    threading.Thread(target=lambda: asked.wait(20) and setattr(lab, "stop", "stopped by SIGINT")).start()
    assert re.search(r"stopped by SIGINT.*nothing was moved", str(refused(lab.run)))
    assert (lab.held_degC, lab.part.exists()) == (None, False)


def test_a_period_that_an_instrument_cannot_hold_is_said_before_the_run_and_while_it_lasts(night):
    lab = night(minutes((1, 22)), {"instruments.multiplexer.period_s": 0.1})
    said = [text for text in lab.run() if text.startswith("multiplexer takes")]
    assert len(said) == 2
    assert all(re.search(r"'period_s' is 0\.1: give it [1-9]", text) for text in said)


def test_after_a_full_disk_the_run_is_resumed(night, monkeypatch):
    """A line is cut; room a moment later does not matter: nothing is written behind it. The trace has none either."""
    write, lines = os.write, itertools.count()
    no_room = Mock(side_effect=OSError(errno.ENOSPC, os.strerror(errno.ENOSPC)))
    fates = [lambda file, data: write(file, data[:10]), no_room]

    def full(file, data):
        journal = os.readlink(f"/proc/self/fd/{file}").endswith(".part")
        return (fates.pop(0) if journal and fates and next(lines) > 20 else write)(file, data)

    monkeypatch.setattr(os, "write", full)
    lab, lacking = night(minutes((2, 22))), Mock(side_effect=refuse("trace.csv", "", "cannot be written", ""))
    with monkeypatch.context() as patch:
        patch.setattr("ambient_trainer.laboratory.collect.save_trace", lacking)
        lab.run()
    assert (lab.outcome.ending, lab.outcome.safe, lab.held_degC) == (Ending.FAILED, True, 20.0)
    assert "No space left" in lab.outcome.why
    assert any("--resume" in text for text in problems_of(lab.outcome, Job(lab.loaded, lab.output)))
    lab.run(work=resume)
    assert (lab.outcome.ending, lab.trace.notes["complete"]) == (Ending.FINISHED, "yes")


MQTT = {"kind": "mqtt-topic", "port": "mqtt://nowhere", "topic": "home/desk"}


@pytest.mark.parametrize("reference", ["host-sensors", "mqtt-topic"])
def test_on_a_desk_there_is_no_chamber(write, tmp_path, reference):
    """It loads, waits until the device is settled, and watches the sensors of this machine, or a topic."""
    desk = yaml.safe_load(Path(scenario_path("desk")).read_text())
    if reference == "mqtt-topic":
        desk["laboratory"].update(instruments={"thermometer": MQTT}, ambient={"probes": ["thermometer"]})
    desk["before"] = [{"settle": {"within_K": 2, "drift_K": 3, "for_min": 1, "at_most_min": 5}}]
    desk["steps"] = minutes((1, None, ["cpu_100"]), (1, None))
    lab = Night(write("desk.yaml", yaml.safe_dump(desk)), tmp_path / "trace.csv")
    lab.run()
    assert (lab.outcome.ending, lab.outcome.safe, lab.activity) == (Ending.FINISHED, True, "idle")
    trace = lab.trace
    assert len(trace.time_s) == 60
    assert np.isfinite(trace.reference).sum() > (20 if reference == "host-sensors" else 8)
    assert np.nanmax(np.abs(trace.reference - 22.0)) < 3.0
    assert "chamber" not in trace.notes
    if reference == "host-sensors":
        assert set(load_trace(laboratory_path(lab.output)).columns) >= {"probe_left_degC", "probe_right_degC"}
        assert "2 sensors" in trace.notes["multiplexer"]
    else:
        assert trace.notes["thermometer"] == "MQTT topic home/desk"


def test_neither_another_campaign_nor_a_second_program_goes_on_with_it(night, campaign_file):
    lab, said = night(minutes((2, 22))), []
    second = [(20.0, lambda there: said.append(refused(resume, lab.job, None).faults[0].problem))]
    lab.run([*second, (30.0, lambda there: setattr(lab, "stop", "enough"))])
    assert said == ["belongs to a run that is not over"]
    other = Night(campaign_file(minutes((2, 23))), lab.output)
    assert re.search(r"'night'.*SHA-256", str(refused(other.run, work=resume)))


@pytest.mark.parametrize(
    ("steps", "changes", "part"),
    [
        (minutes((1, 20, ["dance"])), {"actions.dance": {"start": ":", "stop": ":", "signals": {}}}, "dance"),
        (minutes((1, 20, ["cpu_50", "charging"])), {}, "cpu_50 and charging"),
        (minutes((1, 20)), {"device.zones.skin-therm": "my-skin_degC"}, "my-skin_degC"),
    ],
)
def test_what_the_simulated_phone_lacks_is_refused(night, steps, changes, part):
    assert re.search(part, str(refused(night(steps, changes).run)))
