"""The real afancontrol on the shipped configuration: its fan follows the estimate, and a fault is full speed."""

import configparser
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from device import write_files

SHIPPED = Path(__file__).resolve().parents[2] / "deploy" / "afancontrol" / "afancontrol.conf"


@pytest.fixture(scope="module")
def program(tmp_path_factory):
    """The installed one, or one from the package index in an environment of its own."""
    if found := shutil.which("afancontrol"):
        return found
    folder = tmp_path_factory.mktemp("afancontrol")
    try:
        subprocess.run([sys.executable, "-m", "venv", folder], check=True, capture_output=True, timeout=100)
        install = [folder / "bin" / "pip", "install", "-q", "afancontrol==3.1.0"]
        subprocess.run(install, check=True, capture_output=True, timeout=100)
    except (OSError, subprocess.SubprocessError) as error:
        pytest.skip(f"afancontrol cannot be installed here: {error}")
    return str(folder / "bin" / "afancontrol")


def test_the_fan_follows_the_estimate_and_a_fault_is_full_speed(
    program, spawn, until, deployed, model_file, phone, tmp_path
):
    # a fan as hwmon shows one
    board = write_files(tmp_path, {"pwm1": "0\n", "pwm1_enable": "1\n", "fan1_input": "900\n"})
    published, zones = board / "temp1_input", phone / "class/thermal"
    config = configparser.ConfigParser()
    config.read(SHIPPED)
    assert config["temp:ambient"]["path"] == "/run/ambientd/temp1_input"
    config["daemon"].update(interval="1", pidfile=str(tmp_path / "pid"))
    config["temp:ambient"]["path"] = str(published)
    config["fan:case"].update(pwm=str(board / "pwm1"), fan_input=str(board / "fan1_input"))
    with (tmp_path / "conf").open("w") as stream:
        config.write(stream)
    (tmp_path / "ambientd.json").write_text(
        f'{{"model": "{model_file}", "sysfs_root": "{phone}", "rate_hz": 10, "coast_s": 1, "publish":'
        f' [{{"kind": "file", "path": "{published}", "poison_millidegC": 60000, "at_exit": "poison"}}]}}'
    )
    daemon = spawn(deployed("run", "--config", tmp_path / "ambientd.json"), env={}, stdout=subprocess.DEVNULL)
    until(lambda: published.exists() and published.read_text() == "23000\n", "nothing is published")
    spawn([program, "daemon", "-c", str(tmp_path / "conf")], env=os.environ)

    def warm(millidegC):
        for kind in ("thermal_zone1", "thermal_zone2"):
            (zones / kind / "temp").write_text(f"{millidegC}\n")

    def pwm():
        return int((board / "pwm1").read_text() or -1)

    until(lambda: pwm() == 100, "at 23 degC it does not turn slowly")
    warm(31500)
    until(lambda: pwm() == 120, "at 30 degC it does not turn at half of its line")
    warm(24500)
    until(lambda: pwm() == 100, "it does not fall")
    daemon.kill()
    daemon.wait()
    published.unlink()
    until(lambda: pwm() == 255, "without the file it does not turn at full speed")
    published.write_text("23000\n")
    until(lambda: pwm() == 100, "it does not come back")
    published.write_text("60000\n")
    until(lambda: pwm() == 255, "the poison is not full speed")
