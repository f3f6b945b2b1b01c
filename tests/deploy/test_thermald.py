"""The real thermald on the shipped configuration: it reads the estimate, cools above the trip point and lets go below.

It runs in the foreground, on files of the test's own.
"""

import json
import os
from pathlib import Path

import pytest

from ambientd.config import load_settings
from processes import ran

DEPLOY = Path(__file__).resolve().parents[2] / "deploy"


@pytest.fixture
def thermald(tmp_path, program, spawn):
    """Start thermald, looking once a second, on the shipped configuration with ``paths`` in place of those in it."""
    thermald = program("thermald")
    if os.geteuid() != 0:
        pytest.skip("thermald runs as root only")
    if ran(program("pgrep"), "-x", "thermald", status=None).stdout:
        pytest.skip("a thermald runs here already, and a second one would end at once")

    def start(paths):
        text = (DEPLOY / "thermald" / "thermal-conf.xml").read_text()
        for shipped, ours in paths.items():
            assert text.count(f"<Path>{shipped}</Path>") == 1
            text = text.replace(shipped, str(ours))
        (tmp_path / "conf.xml").write_text(text)
        options = ["--no-daemon", "--loglevel=debug", "--ignore-cpuid-check", "--poll-interval=1"]
        with (tmp_path / "log").open("w") as log:
            return spawn([thermald, *options, "--config-file", str(tmp_path / "conf.xml")], stdout=log)

    return start


def test_the_cooling_device_follows_the_published_ambient_and_cools_after_a_fault(
    thermald, weather, spawn, until, deployed, model_file, write, tmp_path
):
    published, state = tmp_path / "ambient_temp", tmp_path / "state"
    state.write_text("0")
    # the file that the shipped configuration publishes for thermald, elsewhere
    publish = load_settings(str(DEPLOY / "ambientd.yaml")).publish
    [options] = [spec.options._asdict() for spec in publish if spec.path == "/run/ambientd/ambient_temp"]
    ours = {"kind": "file", "path": str(published), **options}
    config = write("ambientd.json", json.dumps({"model": str(model_file), "publish": [ours]}))
    run = deployed("run", "--config", config, "--replay", weather.trace, "--speed", "0")
    weather.start(spawn, run, ambient_degC=23.0)
    until(lambda: published.exists() and published.read_text() == "23000\n", "nothing was published")

    consumer = thermald({"/run/ambientd/ambient_temp": published, "/run/ambientd-cooling/state": state})

    def log():
        return (tmp_path / "log").read_text()

    def level():
        return int(state.read_text() or 0)

    until(lambda: "Sensor ambient_est :temp 23000" in log(), "thermald did not read 23 degC")
    assert level() == 0
    weather.say(33.0)
    until(lambda: "Sensor ambient_est :temp 33000" in log(), "thermald did not read 33 degC")
    until(lambda: level() > 1, "it is 33 degC, and nothing cools, or no more than at first")
    weather.say(27.0)
    until(lambda: level() == 0, "it is 27 degC, and the cooling goes on")
    assert "Sensor ambient_est :temp 27000" in log()
    weather.say(None)
    until(lambda: level() > 0, "nobody knows how warm it is, and nothing cools")
    assert "Sensor ambient_est :temp 60000" in log()
    weather.say(26.0)
    until(lambda: level() == 0, "it is 26 degC, and the cooling goes on")
    weather.kill()
    # what the unit does after the end, however that came
    ran(*deployed("withdraw", "--config", config))
    until(lambda: level() > 0, "the daemon was killed, and nothing cools")
    assert os.listdir(published.parent).count("ambient_temp") == 1
    assert consumer.poll() is None, "thermald ended on its own"
    consumer.terminate()
    assert consumer.wait(timeout=20) == 0
