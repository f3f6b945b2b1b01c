"""The Pixel thermal HAL, compiled from its own sources where they and a compiler are, run on what the daemon publishes.

The sources are others' and not part of this repository. AMBIENTD_PIXEL_HAL_SOURCE is a checkout of AOSP's
hardware/google/pixel, of which ``thermal`` is compiled unchanged; what AOSP gives it stands in ``pixel/aosp.h``, which
also moves every path under HAL_ROOT, and the time by hand. AMBIENTD_PIXEL_HAL holds its parser and the beginning of its
start alone, or these lie beside the repository.
"""

import functools
import json
import os
import re
import subprocess
from pathlib import Path

import pytest

from device import write_files
from processes import ran

DEPLOY = Path(__file__).resolve().parents[2] / "deploy"
SNIPPET = DEPLOY / "pixel" / "thermal_info_config.json"
OF_THE_DEVICE = ("skin_therm", "spare_therm")
"""Kernel zones that the snippet names, and that stand for zones of the device."""
STAND_INS = Path(__file__).with_name("pixel")
HAL = Path(os.environ.get("AMBIENTD_PIXEL_HAL_SOURCE", "absent")) / "thermal"
PARSER = Path(os.environ.get("AMBIENTD_PIXEL_HAL", DEPLOY.parents[1] / "shared/consumers/pixel-hal"))
PARTS = ["thermal-helper.cpp", "virtualtemp_estimator/virtualtemp_estimator.cpp"]
PARTS += [f"utils/{name}.cpp" for name in ("power_files", "thermal_files", "thermal_info", "thermal_stats_helper")]
PARTS += ["utils/thermal_throttling.cpp"]
SKIN_DEGC = 37.0
"""The virtual sensor then throttles from an estimate of 37 degC up, 0.8 * 37 + 0.2 * 37, until it falls below 32."""
WATCHED_S = 10.0
"""Longer than a PollingDelay."""


def compiled(program, source, target, *options):
    if not Path("/usr/include/jsoncpp").is_dir():
        pytest.skip("libjsoncpp-dev is not installed")
    flags = ["-std=c++20", "-w", *options, "-I/usr/include/jsoncpp"]
    ran(program("g++"), *flags, source, "-ljsoncpp", "-o", target, timeout=300)


def test_the_parser_watches_both_sensors_where_the_kernel_has_the_zones(program, tmp_path):
    """The HAL's parser and the beginning of its start, with kernel zones."""
    if not (PARSER / "harness.cpp").is_file():
        pytest.skip("the HAL's parser is not in AMBIENTD_PIXEL_HAL")
    compiled(program, PARSER / "harness.cpp", tmp_path / "harness", f"-I{PARSER}", f"-I{PARSER / 'inc'}")
    parser = functools.partial(ran, tmp_path / "harness", SNIPPET)
    done = parser(*OF_THE_DEVICE)
    assert "spare_therm is_watch=1 path=/dev/ambientd/ambient_temp" in done.stderr
    assert "VIRTUAL-SKIN-AMBIENT is_watch=1" in done.stderr
    done = parser("skin_therm", status=None)
    assert done.returncode != 0
    assert "Could not find spare_therm in sysfs" in done.stderr


@pytest.fixture(scope="module")
def harness(program, tmp_path_factory):
    """``pixel/harness.cpp`` and the HAL in one program."""
    if not (HAL / PARTS[0]).is_file():
        pytest.skip("the HAL's sources are not in AMBIENTD_PIXEL_HAL_SOURCE")
    folder = tmp_path_factory.mktemp("hal")
    sources = [*(HAL / part for part in PARTS), STAND_INS / "harness.cpp"]
    (folder / "all.cpp").write_text("".join(f'#include "{each}"\n' for each in sources))
    for name in re.findall(r"#include <(\S+/\S+)>", "".join(each.read_text() for each in HAL.rglob("*.[ch]*"))):
        if name.split("/")[0] in ("aidl", "android", "android-base", "cutils", "hardware", "netlink", "utils"):
            header = folder / "empty" / name  # aosp.h, included first, stands in for them all
            header.parent.mkdir(parents=True, exist_ok=True)
            header.touch()
    options = [f"-I{folder / 'empty'}", f"-I{HAL}", "-include", STAND_INS / "aosp.h"]
    compiled(program, folder / "all.cpp", folder / "harness", *options)
    return folder / "harness"


class Hal:
    """A running HAL, in a root of its own."""

    def __init__(self, harness, root, spawn, config):
        self.published = root / "dev/ambientd/ambient_temp"
        self.published.parent.mkdir(parents=True)
        (root / "vendor/etc").mkdir(parents=True)
        (root / "vendor/etc/thermal_info_config.json").write_text(json.dumps(config))
        kernel = root / "sys/devices/virtual/thermal"
        for number, kind in enumerate(OF_THE_DEVICE):
            files = {"type": f"{kind}\n", "temp": f"{SKIN_DEGC * 1000:.0f}\n", "policy": "step_wise\n"}
            write_files(kernel / f"thermal_zone{number}", files)
        cooler = {"type": "thermal-cpufreq-0\n", "max_state": "6\n", "cur_state": "0\n"}
        self.cooling = write_files(kernel / "cooling_device0", cooler) / "cur_state"
        self.process = spawn([str(harness)], env={"HAL_ROOT": str(root)}, stdin=subprocess.PIPE)

    def watch(self):
        """Watch for a while: each sensor's temperature in degC and severity."""
        self.process.stdin.write(f"{WATCHED_S}\n")
        self.process.stdin.flush()
        lines = list(iter(self.process.stdout.readline, ".\n"))
        found = [line.split() for line in lines if re.fullmatch(r"\S+ \S+ [A-Z]+\n", line)]
        return {name: (float(value), severity) for name, value, severity in found}


@pytest.fixture
def start(harness, tmp_path, spawn):
    """Start a HAL, with the snippet merged into what a device has, or alone."""
    device = {"Name": "skin_therm", "Type": "SKIN", "Multiplier": 0.001}
    binding = {"CdevRequest": "thermal-cpufreq-0", "LimitInfo": [0, 1, 2, 3, 4, 5, 6]}

    def run(alone=False):
        config = json.loads(SNIPPET.read_text())
        if not alone:
            config["Sensors"][-1]["BindedCdevInfo"] = [binding]
            config["Sensors"].append(device)
            config["CoolingDevices"] = [{"Name": "thermal-cpufreq-0", "Type": "CPU"}]
        return Hal(harness, tmp_path / "root", spawn, config)

    return run


def test_throttling_starts_and_ends_with_the_published_value_and_starts_at_a_fault(
    start, weather, spawn, deployed, model_file, until, write
):
    hal = start()
    config = json.loads((DEPLOY / "android" / "ambientd.json").read_text())
    config["publish"] = [{**config["publish"][0], "path": str(hal.published)}]
    config["model"] = str(model_file)
    written = write("ambientd.json", json.dumps(config))

    def seen_at(millidegC):
        """What is published, as the HAL reads it; the virtual sensor's severity, and the cooling device's state."""
        until(lambda: hal.published.exists() and abs(int(hal.published.read_text()) - millidegC) <= 1)
        sensors = hal.watch()
        published_degC = int(hal.published.read_text()) / 1000
        assert sensors["spare_therm"][0] == pytest.approx(published_degC, abs=0.002)
        expected = 0.8 * SKIN_DEGC + 0.2 * published_degC
        assert sensors["VIRTUAL-SKIN-AMBIENT"][0] == pytest.approx(expected, abs=0.002)
        return sensors["spare_therm"][1], sensors["VIRTUAL-SKIN-AMBIENT"][1], int(hal.cooling.read_text())

    weather.start(spawn, deployed("run", "--config", written, "--replay", weather.trace, "--speed", "0"), 23.0)
    assert seen_at(23000) == ("NONE", "NONE", 0)
    for degC, expected in (
        (36.5, ("MODERATE", "NONE", 0)),
        (38.0, ("MODERATE", "LIGHT", 1)),
        (32.5, ("LIGHT", "LIGHT", 1)),
        (31.0, ("NONE", "NONE", 0)),
    ):
        weather.say(degC, rows=600)
        assert seen_at(degC * 1000) == expected
    weather.say(None)
    assert seen_at(60000) == ("CRITICAL", "SEVERE", 3)
    weather.say(23.0, rows=600)
    assert seen_at(23000) == ("NONE", "NONE", 0)
    weather.kill()
    ran(*deployed("withdraw", "--config", written))
    assert seen_at(60000) == ("CRITICAL", "SEVERE", 3)


def test_the_hal_does_not_start_where_the_guide_says_so(start):
    process = start(alone=True).process
    said, _ = process.communicate(timeout=30)
    assert process.returncode != 0
    assert "Cannot find skin_therm from sensor info map" in said
