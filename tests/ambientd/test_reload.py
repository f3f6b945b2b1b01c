"""SIGHUP: what is good takes over without a gap, what is not changes nothing; and the end comes within a second."""

import json
import os
import signal
import socket
import threading
import time
from pathlib import Path

import pytest

from ambient_model.codec import encode


@pytest.fixture
def configure(tmp_path, model_file, phone):
    """Write the configuration anew, with some keys changed."""

    def write(**changes):
        config = {
            "model": model_file,
            "rate_hz": 20,
            "sysfs_root": str(phone.root),
            "publish": [f"file:{tmp_path}/temp", f"status:{tmp_path}/status", f"socket:{tmp_path}/s"],
        }
        (tmp_path / "c.json").write_text(json.dumps({**config, **changes}))
        return tmp_path / "c.json"

    return write


@pytest.fixture
def status(tmp_path):
    def read():
        path = tmp_path / "status"
        return json.loads(path.read_text()) if path.exists() else {}

    return read


def reload(daemon):
    os.kill(daemon.pid, signal.SIGHUP)


def put(path, content):
    """As a model is replaced on a device: whole."""
    new = f"{path}.new"
    with open(new, "w") as stream:
        stream.write(content)
    os.replace(new, path)


def test_a_new_model_takes_over_without_a_gap(
    start, until, ended, configure, status, make_model, model_file, phone, tmp_path
):
    daemon = start("run", "--config", configure())
    until(lambda: status().get("age_s") == 0.0)
    missed, stop = [], threading.Event()

    def look():
        while not stop.is_set():
            for name in ("temp", "status"):
                try:
                    content = (tmp_path / name).read_text()
                except FileNotFoundError:
                    content = ""
                if not content.endswith("\n"):
                    missed.append(name)

    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as reader:
        reader.settimeout(10)
        reader.connect(f"{tmp_path}/s")
        lines = reader.makefile()
        looker = threading.Thread(target=look)
        looker.start()
        try:
            model = make_model()
            put(model_file, encode(model._replace(name="new", main=model.main._replace(offset=-1.0))))
            reload(daemon)
            heard = [json.loads(lines.readline())]
            while heard[-1]["model"] != "new":
                heard.append(json.loads(lines.readline()))
            heard.append(json.loads(lines.readline()))
        finally:
            stop.set()
            looker.join()
    assert missed == []
    assert {each["status"] for each in heard[-2:]} == {"warming_up"}
    assert heard[0]["ambient_degC"] == pytest.approx(23.0)
    assert heard[-1]["ambient_degC"] == pytest.approx(25.0)
    _, _, log = ended(daemon)
    publish = f"file:{tmp_path}/temp, status:{tmp_path}/status, socket:{tmp_path}/s"
    assert log.splitlines() == [
        f"ambientd: model 'bench' at 0.1 s on sensors under {phone.root}, to {publish}",
        f"ambientd: reloaded: model 'new' at 0.1 s on sensors under {phone.root}, to {publish}",
    ]


def test_an_identical_model_keeps_its_state(start, until, ended, configure, status, phone, tmp_path):
    """The lag on usb is 40 s: after the step only what kept its state is near 33, and anew it would be 25."""
    daemon = start("run", "--config", configure())
    until(lambda: status().get("ambient_degC") == pytest.approx(23.0))
    began_s = status()["time_s"]
    until(lambda: status()["time_s"] > began_s + 0.2)
    with open(phone.root / "class/thermal/thermal_zone10/temp", "r+") as stream:
        stream.write("40000")
    until(lambda: status()["ambient_degC"] > 30)
    configure(level_percent=98)
    reload(daemon)
    until(lambda: status()["level_percent"] == 98)
    assert status()["ambient_degC"] > 28
    assert ended(daemon)[0] == 0


BAD = {
    "cut off": lambda text: text[: len(text) // 2],
    "empty": lambda text: "",
    "unstable": lambda text: text.replace('"A": [\n', '"A": [[9, 0], [0, 9]], "A_": [\n'),
}


@pytest.mark.parametrize("name", BAD)
def test_a_bad_model_is_refused_and_the_old_goes_on(start, until, ended, configure, status, model_file, name):
    daemon = start("run", "--config", configure())
    until(lambda: status().get("model") == "bench")
    with open(model_file) as stream:
        good = stream.read()
    put(model_file, BAD[name](good))
    reload(daemon)
    before = status()["time_s"]
    until(lambda: status()["time_s"] > before + 0.5)
    assert status()["model"] == "bench"
    put(model_file, good)
    reload(daemon)
    before = status()["time_s"]
    until(lambda: status()["time_s"] > before + 0.2)
    _, _, log = ended(daemon)
    said = [line for line in log.splitlines() if line.startswith("ambientd: ")]
    assert said[1].startswith(f"ambientd: not reloaded, the old configuration stays: {model_file}: ")
    assert said[2].startswith("ambientd: reloaded: model 'bench'")
    assert len(said) == 3


def test_publishers_come_and_go_and_those_that_stay_are_not_touched(start, until, ended, configure, status, tmp_path):
    daemon = start("run", "--config", configure())
    until(status)
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as reader:
        reader.settimeout(10)
        reader.connect(f"{tmp_path}/s")
        lines = reader.makefile()
        lines.readline()
        configure(publish=[f"status:{tmp_path}/status", f"socket:{tmp_path}/s", f"prometheus:{tmp_path}/a.prom"])
        reload(daemon)
        until(lambda: (tmp_path / "a.prom").exists())
        assert not (tmp_path / "temp").exists()
        assert [json.loads(lines.readline())["model"] for _ in range(5)] == ["bench"] * 5
        configure(publish=[f"status:{tmp_path}/status"])
        reload(daemon)
        until(lambda: not (tmp_path / "s").exists())
    assert ended(daemon)[0] == 0


def test_a_publisher_that_cannot_start_refuses_the_whole(start, until, ended, configure, status, tmp_path):
    daemon = start("run", "--config", configure())
    until(status)
    (tmp_path / "no-socket").write_text("mine")
    configure(publish=[f"prometheus:{tmp_path}/a.prom", f"socket:{tmp_path}/no-socket"])
    reload(daemon)
    before = status()["time_s"]
    until(lambda: status()["time_s"] > before + 0.5)
    assert (tmp_path / "temp").exists()
    assert (tmp_path / "no-socket").read_text() == "mine"
    _, _, log = ended(daemon)
    assert log.splitlines()[1:] == [
        f"ambientd: not reloaded, the old configuration stays: {tmp_path}/no-socket: exists and is no socket;"
        " remove it, or choose another path"
    ]


def test_a_new_rate_holds(start, until, ended, configure, status):
    daemon = start("run", "--config", configure(rate_hz=0.1))
    until(status)
    first = status()["time_s"]
    configure(rate_hz=20)
    reload(daemon)
    until(lambda: status()["time_s"] != first)  # at once: the next deadline was ten seconds off
    assert status()["time_s"] < first + 9
    assert ended(daemon)[0] == 0


def test_many_reloads_in_a_row_leave_no_descriptor_behind(start, until, ended, configure, status):
    daemon = start("run", "--config", configure())
    until(status)
    count = len(os.listdir(f"/proc/{daemon.pid}/fd"))
    for _ in range(30):
        reload(daemon)
        time.sleep(0.01)
    before = status()["time_s"]
    until(lambda: status()["time_s"] > before + 0.5)
    assert len(os.listdir(f"/proc/{daemon.pid}/fd")) == count
    assert ended(daemon)[0] == 0


def test_it_ends_though_its_reader_has_stopped_reading(start, until, model_file, tmp_path):
    """As fast as it goes it waits for ever for a full pipe; the signal comes through."""
    trace = tmp_path / "long.csv"
    trace.write_text("time_s,usb_degC,battery_degC\n" + "".join(f"{k},30,25\n" for k in range(20000)))
    daemon = start(
        *("run", "--model", model_file, "--replay", trace, "--speed", "0"),
        *("--publish", f"file:{tmp_path}/temp", "--publish", "stdout"),
    )
    until(lambda: (tmp_path / "temp").exists())
    until(lambda: "\nState:\tS" in Path(f"/proc/{daemon.pid}/status").read_text())
    os.kill(daemon.pid, signal.SIGTERM)
    assert daemon.wait(10) == 0
    assert not (tmp_path / "temp").exists()
    assert daemon.stderr.read().splitlines()[1:] == ["ambientd: something blocked at the end and was abandoned"]
