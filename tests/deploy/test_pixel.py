"""The Pixel thermal HAL's snippet, run through the HAL's own parser and start where their sources and a compiler are.

The sources are others' and not part of this repository: they lie beside it, or where AMBIENTD_PIXEL_HAL says.
"""

import json
import os
import subprocess
from pathlib import Path

import pytest

DEPLOY = Path(__file__).resolve().parents[2] / "deploy"
SNIPPET = DEPLOY / "pixel" / "thermal_info_config.json"
OF_THE_DEVICE = ("skin_therm", "spare_therm")
"""Kernel zones that the snippet names, and that stand for zones of the device."""


@pytest.fixture
def sensors():
    return {each["Name"]: each for each in json.loads(SNIPPET.read_text())["Sensors"]}


def test_it_reads_what_android_publishes_and_a_fault_throttles_but_shuts_nothing_down(sensors):
    published = json.loads((DEPLOY / "android" / "ambientd.json").read_text())["publish"][0]
    estimate, virtual = sensors["spare_therm"], sensors["VIRTUAL-SKIN-AMBIENT"]
    assert (estimate["TempPath"], estimate["Multiplier"]) == (published["path"], 0.001)
    assert virtual["Combination"] == list(OF_THE_DEVICE)
    poison_degC = published["poison_millidegC"] / 1000
    shares = [float(each) for each in virtual["Coefficient"]]
    assert sum(shares) == pytest.approx(1)
    for sensor, value in ((estimate, poison_degC), (virtual, shares[0] * 35 + shares[1] * poison_degC)):
        none, light, moderate, severe, critical, emergency, shutdown = sensor["HotThreshold"]
        assert (none, emergency, shutdown) == ("NAN",) * 3, "an estimate alone shuts no phone down"
        assert light < moderate < severe < critical
        assert value >= moderate, "what a fault leaves throttles"
    assert published["at_exit"] == "poison"


@pytest.fixture(scope="module")
def hal(program, tmp_path_factory):
    """The HAL's parser and the beginning of its start, compiled: gives exit status and what it says of the sensors."""
    sources = Path(os.environ.get("AMBIENTD_PIXEL_HAL", DEPLOY.parents[1] / "shared/consumers/pixel-hal"))
    if not (sources / "harness.cpp").is_file():
        pytest.skip("the HAL's sources are not in AMBIENTD_PIXEL_HAL")
    harness = tmp_path_factory.mktemp("hal") / "harness"
    folders = [f"-I{sources}", f"-I{sources / 'inc'}", "-I/usr/include/jsoncpp"]
    call = [program("g++"), "-std=c++20", "-w", *folders, str(sources / "harness.cpp"), "-ljsoncpp", "-o", str(harness)]
    built = subprocess.run(call, capture_output=True, text=True, timeout=300)
    if built.returncode != 0:
        errors = [line for line in built.stderr.splitlines() if "error: " in line]
        pytest.skip(f"the HAL does not compile here: {errors[0] if errors else built.stderr[-200:]}")

    def run(*zones):
        done = subprocess.run([harness, SNIPPET, *zones], capture_output=True, text=True, timeout=30)
        return done.returncode, done.stderr

    return run


def test_the_hal_starts_with_it_and_watches_both_sensors(hal):
    status, said = hal(*OF_THE_DEVICE)
    assert status == 0, said
    assert "spare_therm is_watch=1 path=/dev/ambientd/ambient_temp" in said
    assert "VIRTUAL-SKIN-AMBIENT is_watch=1" in said
    assert "initializeSensorMap 1" in said


def test_the_hal_does_not_start_where_the_name_is_no_kernel_zone(hal):
    """The guide says so: ``Name`` is a zone that the kernel has, and the HAL's own file does not use."""
    status, said = hal("skin_therm")
    assert status != 0
    assert "Could not find spare_therm in sysfs" in said
