"""The client against what lies in files and comes from sockets, whole, torn, old or hostile; nothing of it hangs."""

import json
import math
import os
import re
import socket
import threading
import time
from pathlib import Path

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from ambientd import client
from ambientd.client import Absent, Follower, Malformed, NoValue, Poisoned, Reading, Sensor, Stale
from documents import anything


def line(time_s=12.5, status="tracking", ambient_degC=23.4, **changes):
    low, high = (ambient_degC - 0.5, ambient_degC + 0.75) if isinstance(ambient_degC, float) else (None, None)
    said = {
        "time_s": time_s,
        "model": "bench",
        "status": status,
        "ambient_degC": ambient_degC,
        "low_degC": low,
        "high_degC": high,
        "level_percent": 90,
        "age_s": 0.0,
        "sensors": {"usb": {"unit": "degC", "raw": None, "used": 30.0}},
    }
    return json.dumps({**said, **changes}).encode() + b"\n"


@pytest.fixture
def value_file(tmp_path):
    """Write a file, some seconds ago."""

    def write(content, ago_s=0.0):
        path = tmp_path / "file"
        path.write_bytes(content)
        os.utime(path, (time.time() - ago_s,) * 2)
        return str(path)

    return write


def test_a_files_offset_is_subtracted_and_not_from_its_poison(value_file):
    path = value_file(b"95000\n")
    assert client.read_file_degC(path, 60, offset_millidegC=100_000) == -5.0
    with pytest.raises(Poisoned, match="95000"):
        client.read_file_degC(path, 60, poison_millidegC=95_000, offset_millidegC=100_000)


@pytest.mark.parametrize(
    ("content", "ago_s", "kind"),
    [
        (b"23400\n", 61, Stale),
        (b"23400\n", -61, Stale),  # written before the clock was set back
        (b"60000\n", 0, Poisoned),
        (b"-274000\n", 0, Poisoned),
        (b"26.5\n", 0, Malformed),
    ],
)
def test_a_file_without_a_trustworthy_value_gives_none(value_file, content, ago_s, kind):
    path = value_file(content, ago_s)
    with pytest.raises(kind, match=f"^{path}: "):
        client.read_file_degC(path, 60, poison_millidegC=60_000)


def test_what_is_not_there_or_no_file_neither_gives_a_value_nor_hangs(tmp_path):
    with pytest.raises(Absent):
        client.read_file_degC(str(tmp_path / "none"), 60)
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path / "pipe", tmp_path):
        with pytest.raises(Malformed):
            client.read_file_degC(str(path), 60)
    with pytest.raises(Malformed):
        client.read_status("/dev/zero", 60)


@given(content=st.binary(max_size=20) | st.from_regex(rb"\A-?[0-9]{1,14}\n{0,3}\Z"))
@example(content=b"-273150\n")
@example(content=b"5000\n\n\n")
def test_whatever_a_file_holds_it_is_a_value_or_none(content, tmp_path_factory):
    path = tmp_path_factory.mktemp("values") / "file"
    path.write_bytes(content)
    try:
        degC = client.read_file_degC(str(path), 60)
    except NoValue:
        whole = re.fullmatch(rb"(-?[0-9]+)\n+", content)
        assert whole is None or len(content) > 15 or int(whole[1]) < -273_150
    else:
        assert degC == int(content) / 1000 >= -273.15


def test_a_line_becomes_a_reading():
    assert client.parse_reading(line(12)) == Reading(
        12.0, "bench", "tracking", 23.4, 22.9, 24.15, 90, 0.0, {"usb": Sensor("degC", None, 30.0)}
    )
    faulted = line(status="faulted", ambient_degC=None, age_s=None, later="more")
    assert client.parse_reading(faulted).ambient_degC is None


@pytest.mark.parametrize(
    "wrong",
    [
        line()[:-30],
        line().decode().encode("utf-16"),
        b"[" * 60000,
        line(time_s=None),
        line(ambient_degC=math.nan),
        line(ambient_degC=-300.0),
        line(status="fine"),
        line(status="faulted"),
        line(ambient_degC=None),
        line(sensors={"usb": 30.0}),
    ],
    ids=range(10),
)
def test_a_line_that_the_daemon_does_not_write_is_no_reading(wrong):
    with pytest.raises(ValueError, match=r"^is no reading") as refused:
        client.parse_reading(wrong)
    assert len(str(refused.value)) <= 200


@settings(max_examples=50)
@given(
    content=st.binary(max_size=200)
    | st.builds(lambda cut, more: line()[:cut] + more, st.integers(0, 300), st.binary(max_size=20))
    | st.builds(
        lambda changes: line(**changes), st.dictionaries(st.sampled_from([*json.loads(line())]), anything(), max_size=3)
    )
)
def test_whatever_a_line_holds_it_is_a_finite_reading_or_none(content):
    try:
        reading = client.parse_reading(content)
    except ValueError:
        return
    values = [reading.ambient_degC, reading.low_degC, reading.high_degC]
    assert all(value is None for value in values) == (reading.status == "faulted")
    assert all(math.isfinite(value) for value in [reading.time_s, reading.age_s or 0.0, *values] if value is not None)
    assert reading.status in client.STATUSES


def test_a_status_file_is_read_and_its_age_counts(value_file):
    assert client.read_status(value_file(line()), 60) == client.parse_reading(line())
    with pytest.raises(Stale):
        client.read_status(value_file(line(), 61), 60)
    with pytest.raises(Malformed, match="is no reading"):
        client.read_status(value_file(line()[:50]), 60)


def served(path):
    """A daemon's socket in the hands of the test."""
    listener = socket.create_server(path, family=socket.AF_UNIX)
    listener.settimeout(10)
    return listener


@pytest.fixture
def server(path):
    with served(path) as listener:
        yield listener


def test_each_line_is_a_reading_and_halves_are_joined(server, path):
    with Follower(path, 60) as follower:
        assert follower.wait(0) is None
        with server.accept()[0] as daemon:
            daemon.sendall(line(1) + line(2) + line(3)[:20])
            assert [follower.wait(10).time_s, follower.wait(10).time_s] == [1, 2]
            assert follower.wait(0) is None
            daemon.sendall(line(3)[20:])
            assert follower.wait(10).time_s == 3
            assert follower.newest().time_s == 3
            assert (follower.skipped, follower.problem) == (0, "")


def test_who_talks_without_lines_is_left(server, path):
    with Follower(path, 60) as follower:
        follower.wait(0)
        with server.accept()[0] as talker:
            sender = threading.Thread(target=lambda: talker.sendall(b"x" * 65537))
            sender.start()
            while not follower.problem:
                assert follower.wait(0.01) is None
            sender.join()
        assert follower.problem == "what is received has no lines"


def test_without_a_daemon_it_tries_ever_more_rarely_and_never_hangs(path, monkeypatch):
    follower, tried = Follower(path, 5), []
    connect = follower._connect
    monkeypatch.setattr(follower, "_connect", lambda now_s: (tried.append(now_s), connect(now_s)))
    with pytest.raises(Absent, match="not connected yet"):
        follower.newest()
    assert follower.wait(0.8) is None
    assert 2 <= len(tried) <= 4, "after 0.1, 0.2 and 0.4 s"
    assert follower.problem == "No such file or directory"


def test_what_had_to_wait_for_its_consumer_is_as_old_as_it_is(server, path, monkeypatch):
    """The daemon's buffer for a consumer that slept holds the eldest lines, not the newest."""
    clock = [1000.0]
    monkeypatch.setattr(client, "clock_s", lambda: clock[0])
    with Follower(path, 5) as follower:
        follower.wait(0)
        with server.accept()[0] as daemon:
            threading.Timer(0.05, daemon.sendall, [line(100)]).start()
            assert follower.wait(3).time_s == 100
            daemon.sendall(line(101) + line(102) + line(158))
            clock[0] += 60
            assert follower.wait(0).time_s == 158  # 101 and 102 are no news
            assert follower.age_s == pytest.approx(2)
            clock[0] += 4
            with pytest.raises(Stale):
                follower.newest()
            threading.Timer(0.05, daemon.sendall, [line(164)]).start()
            assert follower.wait(3).time_s == 164
            assert follower.age_s == pytest.approx(0)


@given(chunks=st.lists(st.binary(max_size=300) | st.just(line(1)) | st.just(line(2)[:40]), max_size=6))
def test_whatever_comes_is_taken_in_whole_lines(chunks, tmp_path_factory):
    path = str(tmp_path_factory.mktemp("s") / "s")
    with served(path) as server, Follower(path, 60) as follower:
        follower.wait(0)
        with server.accept()[0] as daemon:
            daemon.sendall(b"".join(chunks))
        heard = []
        while not follower.problem or follower._waiting:
            reading = follower.wait(0)
            heard += [] if reading is None else [reading]
    assert len(heard) + follower.skipped == len(b"".join(chunks).split(b"\n")[:-1])
    assert all(isinstance(each, Reading) for each in heard)


def test_it_may_be_copied_and_reads_a_file_without_sockets_or_json(ambientd, tmp_path):
    (tmp_path / "copied.py").write_bytes(Path(client.__file__).read_bytes())
    (tmp_path / "value").write_text("23400\n")
    code = (
        f"import sys; sys.path.insert(0, {str(tmp_path)!r}); import copied\n"
        f"print(copied.read_file_degC({str(tmp_path / 'value')!r}, 60))\n"
        "print(*sorted({'json', 'socket', 'ambientd', 'ambient_model', 'logging', 'asyncio'} & set(sys.modules)))"
    )
    done = ambientd(by=("-I", "-S", "-c", code))
    assert (done.stdout, done.stderr) == ("23.4\n\n", "")


def test_the_example_in_its_docstring_runs(start, until, on_phone, tmp_path):
    start(*on_phone(f"socket:{tmp_path}/s", f"file:{tmp_path}/temp"))
    until((tmp_path / "temp").exists)
    example = client.__doc__.split("::\n\n", 1)[1].split("\n\nNothing here", 1)[0]
    code = "\n".join(text[4:] for text in example.splitlines())
    code = code.replace("/run/ambientd/ambient.sock", f"{tmp_path}/s")
    code = code.replace("/run/ambientd/ambient_temp", f"{tmp_path}/temp")
    acted, ending = [], iter([1, 1, 1, 0])  # divided by the last, it ends

    def act_on(ambient_degC):
        acted.append(ambient_degC / next(ending))

    with pytest.raises(ZeroDivisionError):
        exec(code, {"act_on": act_on, "act_without_it": lambda: None})
    assert acted == pytest.approx([23.0] * 3)
