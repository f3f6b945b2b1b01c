"""What a real daemon leaves at its end, and what a reload makes of a publication that is configured otherwise."""

import json
import os
import signal

import pytest


@pytest.fixture
def configure(tmp_path, model_file, phone):
    """Write a configuration that publishes one file, in ``out``."""
    (tmp_path / "out").mkdir()

    def write(**publication):
        spec = {"kind": "file", "path": f"{tmp_path}/out/temp", "poison_millidegC": 60000, **publication}
        publish = [spec, f"status:{tmp_path}/status"]
        config = {"model": model_file, "rate_hz": 20, "sysfs_root": str(phone.root), "publish": publish}
        (tmp_path / "c.json").write_text(json.dumps(config))
        return tmp_path / "c.json"

    return write


@pytest.fixture
def said(tmp_path):
    def read():
        path = tmp_path / "out" / "temp"
        return path.read_text() if path.exists() else None

    return read


@pytest.mark.parametrize("mode", ["rename", "in-place"])
@pytest.mark.parametrize("at_exit", ["remove", "poison"])
def test_the_file_goes_or_says_the_poison(start, until, ended, configure, said, tmp_path, mode, at_exit):
    daemon = start("run", "--config", configure(mode=mode, at_exit=at_exit))
    until(lambda: said() == "23000\n")
    assert ended(daemon)[0] == 0
    assert said() == ("60000\n" if at_exit == "poison" else None)
    assert os.listdir(tmp_path / "out") == (["temp"] if at_exit == "poison" else [])


def test_who_keeps_it_open_in_place_hears_the_next_daemon(start, until, ended, configure, said, tmp_path):
    daemon = start("run", "--config", configure(mode="in-place", at_exit="poison"))
    until(lambda: said() == "23000\n")
    with open(tmp_path / "out" / "temp", "rb", buffering=0) as reader:
        ended(daemon)
        assert os.pread(reader.fileno(), 15, 0) == b"60000\n"
        start("run", "--config", configure(mode="in-place", at_exit="poison"))
        until(lambda: os.pread(reader.fileno(), 15, 0) == b"23000\n")


def test_a_reload_to_another_offset_leaves_no_gap_and_to_another_mode_comes_back(
    start, until, ended, configure, said, tmp_path
):
    daemon = start("run", "--config", configure())
    until(lambda: said() == "23000\n")
    configure(offset_millidegC=100_000)
    os.kill(daemon.pid, signal.SIGHUP)
    until(lambda: said() != "23000\n")  # never absent: None would end this, too
    assert said() == "123000\n"
    configure(offset_millidegC=100_000, mode="in-place")
    os.kill(daemon.pid, signal.SIGHUP)
    before = (tmp_path / "status").stat().st_ino
    until(lambda: (tmp_path / "status").stat().st_ino != before)
    until(lambda: said() == "123000\n")
    status, _, log = ended(daemon)
    assert (status, len(log.splitlines())) == (0, 3)
    assert said() is None
