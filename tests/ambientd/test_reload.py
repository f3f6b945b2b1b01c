"""SIGHUP: a good configuration takes over without a gap, a bad one changes nothing; the end comes within a second."""

import json
import os
import signal
import threading
from pathlib import Path

import pytest

from ambient_model.codec import encode
from ambientd.publish.claims import Claims

from .conftest import text


@pytest.fixture
def configure(tmp_path, configure):
    """Write the configuration anew, with some keys changed; ``file`` are keys of the published file."""

    def write(file=None, **changes):
        out = {"kind": "file", "path": f"{tmp_path}/temp", **(file or {})}
        return configure(**{"publish": [out, f"status:{tmp_path}/status", f"socket:{tmp_path}/s"], **changes})

    return write


@pytest.fixture
def running(start, until, configure, status):
    """A running daemon with some keys changed."""

    def run(**changes):
        daemon = start("run", "--config", configure(**changes))
        until(lambda: status().get("model") == "bench")
        return daemon

    return run


@pytest.fixture
def reload(until, status):
    """Ask the daemon to reload and wait until it has ticked for a while."""

    def ask(daemon, wait_s=0.3):
        os.kill(daemon.pid, signal.SIGHUP)
        before = status()["time_s"]
        until(lambda: not wait_s or status()["time_s"] > before + wait_s)

    return ask


def put(path, content):
    """As a model is replaced on a device: whole."""
    Path(f"{path}.new").write_text(content)
    os.replace(f"{path}.new", path)


def test_a_new_model_takes_over_without_a_gap(running, reload, listen, ended, make_model, model_file, tmp_path):
    daemon = running()
    missed, stop = [], threading.Event()

    def look():
        while not stop.is_set():
            for name in ("temp", "status"):
                path = tmp_path / name
                if not path.exists() or not path.read_text().endswith("\n"):
                    missed.append(name)

    lines = listen(tmp_path / "s")
    looker = threading.Thread(target=look)
    looker.start()
    try:
        model = make_model()
        put(model_file, encode(model._replace(name="new", main=model.main._replace(offset=-1.0))))
        reload(daemon, 0)
        heard = [json.loads(lines.readline())]
        while heard[-1]["model"] != "new":
            heard.append(json.loads(lines.readline()))
    finally:
        stop.set()
        looker.join()
    assert missed == []
    assert (heard[0]["ambient_degC"], heard[-1]["ambient_degC"]) == pytest.approx((23.0, 25.0))
    assert heard[-1]["status"] == "warming_up"
    _, _, log = ended(daemon)
    assert [" reloaded: model 'new'" in line for line in log.splitlines()] == [False, True]


def test_an_identical_model_keeps_its_state(running, reload, until, ended, configure, status, phone):
    """The lag on usb is 40 s: after the step only what kept its state is near 33, and anew it would be 25."""
    daemon = running()
    began_s = status()["time_s"]
    until(lambda: status()["time_s"] > began_s + 0.2)
    with open(phone.root / "class/thermal/thermal_zone10/temp", "r+") as stream:
        stream.write("40000")
    until(lambda: status()["ambient_degC"] > 30)
    configure(level_percent=98)
    reload(daemon, 0)
    until(lambda: status()["level_percent"] == 98)
    assert status()["ambient_degC"] > 28
    assert ended(daemon)[0] == 0


BAD_MODELS = {
    "cut off": lambda text: text[: len(text) // 2],
    "unstable": lambda text: text.replace('"A": [\n', '"A": [[9, 0], [0, 9]], "A_": [\n'),
}
BAD_KEYS = {
    "no keys": ({"rate_hz": 0, "level_percent": 1}, "rate_hz: "),
    "no folder": ({"publish": ["file:{}/none/temp"]}, "/none/temp: cannot be written"),
    "one good, one bad": ({"publish": ["prometheus:{}/a.prom", "file:{}/folder"]}, "/folder: cannot be written"),
    "no socket": ({"publish": ["socket:{}/mine"]}, "/mine: cannot be written"),
    "another daemon's": ({"publish": ["file:{}/locked"]}, "/locked: another daemon"),
    "a pipe": ({"publish": ["file:{}/pipe"]}, "/pipe: exists and is no file"),
    "state": ({"state": {"path": "{}/none/state"}}, "/none/state: cannot be written"),
    "sensor": ({"zones": {"usb": "typo"}}, "sensor usb: "),
    "root": ({"sysfs_root": "{}/none"}, "sensor usb: "),
}


def test_a_fault_in_any_part_changes_nothing_and_is_said_once(
    running, reload, until, ended, configure, status, model_file, listen, tmp_path
):
    """Neither what is published, nor what lies beside it."""
    (tmp_path / "mine").write_text("mine")
    (tmp_path / "folder").mkdir()
    os.mkfifo(tmp_path / "pipe")
    claims = Claims()
    claims.take(str(tmp_path / "locked"))
    daemon = running()
    until(lambda: text(tmp_path / "temp") == "23000\n")
    before = {path.name for path in tmp_path.iterdir()}
    good = Path(model_file).read_text()
    said = []

    def refused():
        reload(daemon, 0.1)
        said.append((text(tmp_path / "temp"), status()["model"], status()["status"]))
        assert {path.name for path in tmp_path.iterdir() if not path.name.endswith(".part")} == before

    lines = listen(tmp_path / "s")
    for broken in BAD_MODELS.values():
        put(model_file, broken(good))
        refused()
    put(model_file, good)
    for keys, _ in BAD_KEYS.values():
        configure(**json.loads(json.dumps(keys).replace("{}/", f"{tmp_path}/")))
        refused()
    configure()
    reload(daemon)
    assert len(lines.readline()) > 1, "a reader of the socket was sent away"
    claims.keep([])
    _, _, log = ended(daemon)
    assert {each[:2] for each in said} == {("23000\n", "bench")}
    assert sum("not reloaded" in line for line in log.splitlines()) == len(said)
    assert [fact for _, fact in BAD_KEYS.values() if fact not in log] == []
    assert log.splitlines()[-1].startswith("ambientd: reloaded: model 'bench'")
    assert (tmp_path / "mine").read_text() == "mine"


def test_publishers_come_and_go_and_those_that_stay_are_not_touched(
    running, reload, until, ended, configure, listen, tmp_path
):
    daemon = running()
    stay = [f"status:{tmp_path}/status", f"socket:{tmp_path}/s"]
    lines = listen(tmp_path / "s")
    configure(publish=[*stay, f"prometheus:{tmp_path}/a.prom"])
    reload(daemon, 0)
    until(lambda: (tmp_path / "a.prom").exists())
    assert not (tmp_path / "temp").exists()
    assert [json.loads(lines.readline())["model"] for _ in range(5)] == ["bench"] * 5
    configure(publish=stay[:1])
    reload(daemon, 0)
    until(lambda: not (tmp_path / "s").exists())
    assert ended(daemon)[0] == 0


def test_a_new_rate_holds(running, reload, until, ended, configure, status):
    daemon = running(rate_hz=0.1)
    first = status()["time_s"]
    configure(rate_hz=20)
    reload(daemon, 0)
    until(lambda: status()["time_s"] != first)  # at once: the next deadline was ten seconds off
    assert status()["time_s"] < first + 9
    assert ended(daemon)[0] == 0


def test_another_offset_leaves_no_gap_and_another_mode_comes_back(running, reload, until, ended, configure, tmp_path):
    temp = tmp_path / "temp"
    daemon = running()
    until(lambda: text(temp) == "23000\n")
    configure(file={"offset_millidegC": 100_000})
    reload(daemon, 0)
    until(lambda: text(temp) != "23000\n")  # never absent: that would end this, too
    assert text(temp) == "123000\n"
    configure(file={"offset_millidegC": 100_000, "mode": "in-place"})
    reload(daemon)
    until(lambda: text(temp) == "123000\n")
    status, _, log = ended(daemon)
    assert (status, len(log.splitlines()), temp.exists()) == (0, 3, False)


def test_it_ends_though_its_reader_has_stopped_reading(start, until, model_file, write_trace, tmp_path):
    """As fast as it goes it waits for ever for a full pipe; the signal comes through."""
    run = ("run", "--model", model_file, "--replay", write_trace([(k, 30, 25) for k in range(20000)]), "--speed", "0")
    daemon = start(*run, "--publish", f"file:{tmp_path}/temp", "--publish", "stdout")
    until(lambda: (tmp_path / "temp").exists())
    until(lambda: "\nState:\tS" in Path(f"/proc/{daemon.pid}/status").read_text())
    os.kill(daemon.pid, signal.SIGTERM)
    assert daemon.wait(10) == 0
    assert not (tmp_path / "temp").exists()
    assert len(daemon.stderr.read().splitlines()) == 2
