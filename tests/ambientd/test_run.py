"""The daemon as a real process: zones in, publications out, a clean end."""

import contextlib
import json
import os
import signal
import threading
from types import SimpleNamespace
from unittest.mock import Mock

import pytest

from ambient_model.faults import Refused
from ambientd.fallback import FallbackTracker
from ambientd.run import _Pace
from ambientd.schedule import Waiter, clock_s
from ambientd.service import Service

from .conftest import text


def test_it_follows_the_zones_and_leaves_nothing_behind(start, until, ended, on_phone, phone, tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    kinds = (f"file:{out}/temp", f"file-in-place:{out}/same", f"status:{out}/status", f"prometheus:{out}/a.prom")
    daemon = start(*on_phone(*kinds, f"socket:{out}/s"))
    until(lambda: text(out / "temp") == "23000\n")
    with open(phone.root / "class/thermal/thermal_zone10/temp", "r+") as zone:
        zone.write("31000")
    until(lambda: 'ambientd_sensor_used{sensor="usb",unit="degC"} 31.0' in text(out / "a.prom"))
    until(lambda: json.loads(text(out / "status"))["sensors"]["usb"] == {"unit": "degC", "raw": 31.0, "used": 31.0})
    # usb counts at once, and is then drawn from as its lag follows
    assert 23200 < int(text(out / "temp")) <= 24000
    assert 23200 < int(text(out / "same")) <= 24000
    status, said, log = ended(daemon)
    assert (status, said) == (0, "")
    assert os.listdir(out) == []
    to = ", ".join([*kinds, f"socket:{out}/s"])
    assert log == f"ambientd: model 'bench' at 0.1 s on sensors under {phone.root}, to {to}\n"


def test_without_any_zone_it_runs_faulted_until_they_come(start, until, ended, on_phone, phone, status, tmp_path):
    zones = phone.root / "class/thermal"
    zones.rename(tmp_path / "later")
    zones.mkdir()
    daemon = start(*on_phone(f"status:{tmp_path}/status", f"file:{tmp_path}/temp"))
    until(lambda: status().get("status") == "faulted")
    assert not (tmp_path / "temp").exists()
    (tmp_path / "later").rename(zones)
    until(lambda: text(tmp_path / "temp") == "23000\n")
    assert ended(daemon)[0] == 0


def test_a_reader_of_stdout_that_leaves_does_not_end_it(start, until, ended, on_phone, tmp_path):
    daemon = start(*on_phone("stdout", f"status:{tmp_path}/status"))
    daemon.stdout.close()
    until(lambda: text(tmp_path / "status"))
    before = text(tmp_path / "status")
    until(lambda: text(tmp_path / "status") != before)
    os.kill(daemon.pid, signal.SIGTERM)
    assert daemon.wait(15) == 0
    assert daemon.stderr.read().splitlines()[1:] == [
        "ambientd: stdout: cannot be written (Broken pipe); the others go on"
    ]


def test_a_full_pipe_on_stdout_delays_nothing(start, model_file, write_trace):
    """A thousand rows a second fill the pipe that no one reads; what goes in is whole lines, and it ends on time."""
    trace = write_trace([(k, 30, 25) for k in range(2000)])
    daemon = start("run", "--model", model_file, "--replay", trace, "--speed", "1000")
    assert daemon.wait(15) == 0  # it reached the last row with the pipe full
    said, _ = daemon.communicate()
    times = [json.loads(line)["time_s"] for line in said.splitlines()]
    assert 0 < len(times) < 2000
    assert times == sorted(times)


def test_a_rate_paces_a_replay_by_rows(start, ended, model_file, write_trace):
    """What lies between the rows in the trace is not waited for."""
    trace = write_trace([(k * 25.0, 30.0, 25.0) for k in range(5)])
    out, _ = start("run", "--model", model_file, "--replay", trace, "--rate", "20").communicate(timeout=15)
    assert [json.loads(line)["time_s"] for line in out.splitlines()] == [0.0, 25.0, 50.0, 75.0, 100.0]


def test_a_trace_with_a_fault_ends_with_1_and_leaves_nothing_behind(ambientd, model_file, write_trace, tmp_path):
    trace = write_trace([*((float(k), 30.0, 25.0) for k in range(300)), (1.0, 30.0, 25.0)])
    done = ambientd(
        *("run", "--model", model_file, "--replay", trace, "--speed", "0"),
        *("--publish", f"file:{tmp_path}/temp", "--publish", f"socket:{tmp_path}/s"),
        status=1,
    )
    assert done.stderr.splitlines()[1:] == [
        f"ambientd: {trace}: line 302, column time_s: 1 s does not come after 299 s;"
        " sort the rows and drop doubles: time must increase"
    ]
    assert not (tmp_path / "temp").exists()
    assert not (tmp_path / "s").exists()


def test_who_connects_between_two_ticks_is_served_before_the_next(start, until, on_phone, status, listen, tmp_path):
    """Ten seconds lie between two ticks; the line that is there is told long before."""
    start(*on_phone(f"socket:{tmp_path}/s", f"status:{tmp_path}/status"), "--rate", "0.1")
    until(status)
    assert json.loads(listen(tmp_path / "s").readline()) == status()


def test_a_configuration_runs_it_and_the_call_overrides_it_until_ctrl_c(start, ended, phone, model_file, tmp_path):
    config = tmp_path / "ambientd.yaml"
    config.write_text(
        "model: model.json\nrate_hz: 0.1\nsysfs_root: /nowhere\nlevel_percent: 98\n"
        "publish:\n  - {kind: file, path: temp, mode: in-place, poison_millidegC: -40000}\n"
    )
    daemon = start("run", "--config", config, "--sysfs-root", phone.root, "--rate", "20", "--publish", "stdout")
    line = [json.loads(daemon.stdout.readline()) for _ in range(2)][1]
    assert [line[key] for key in ("level_percent", "low_degC", "high_degC")] == pytest.approx([98, 22.0, 24.5])
    assert not (tmp_path / "temp").exists()
    status, _, log = ended(daemon, signal.SIGINT)
    assert (status, "Traceback" in log) == (0, False)


NONE_LEFT = Mock(side_effect=RuntimeError("can't start new thread"))


@pytest.mark.parametrize("spare", [True, False])
def test_where_the_work_hangs_another_thread_goes_on_or_it_is_refused(spare, monkeypatch):
    begun, returned = [], threading.Event()

    def work():
        begun.append(threading.get_ident())
        if len(begun) == 1:
            if not spare:
                monkeypatch.setattr("_thread.start_new_thread", NONE_LEFT)
            waiter.set_alarm(0.01)
            returned.wait(10)
            raise SystemExit

    with Waiter() as waiter, contextlib.nullcontext() if spare else pytest.raises(Refused, match="TasksMax"):
        waiter.carry_out(work, lambda: True)
    returned.set()
    assert len(set(begun)) == 1 + spare


def test_without_a_thread_to_spare_the_work_is_done_all_the_same(monkeypatch):
    monkeypatch.setattr("_thread.start_new_thread", NONE_LEFT)
    done = []
    with Waiter() as waiter:
        waiter.carry_out(lambda: done.append(1), lambda: False)
    assert done == [1]


@pytest.mark.parametrize(("missed", "said"), [(3, "3 of 10 were missed"), (300, "for 300 s: a sensor hung, or")])
def test_a_pause_is_told_from_ticks_that_cannot_be_held(missed, said, capfd):
    ticks = SimpleNamespace(missed=0, back_s=0.0)
    pace = _Pace(ticks, 1.0)
    ticks.missed = missed
    pace.ticked(clock_s() + 11)
    assert said in capfd.readouterr().err
    pace.ticked(clock_s() + 22)
    assert "held again" in capfd.readouterr().err


def test_age_grows_while_the_estimate_rests_on_memory(make_model):
    model, reports = make_model(), []
    samples = [(0.0, [30.0, None]), (1.0, [30.0, 25.0]), (2.0, [30.0, None]), (3.5, [30.0, None]), (4.0, [30.0, 25.0])]
    service = Service(model, 90, FallbackTracker(model, 1.0), reports.append)
    for sample in samples:
        service.tick(sample)
    assert [each.age_s for each in reports] == [None, 0.0, 1.0, 2.5, 0.0]
    assert [each.raw for each in reports] == [values for _, values in samples]
