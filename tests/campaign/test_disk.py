"""Where it publishes fails: the disk is full, the folder gone, no one takes the log. What stays is true or nothing."""

import contextlib
import json
import os
import shutil
import socket
import subprocess

import pytest

from processes import content_of

from .conftest import Outputs
from .observer import number_in


def newest_or_nothing(daemon, zones, count, first):
    """Ticks in which every value differs from the last: of those that are published, none is older than the tick."""
    for k in range(first, first + count):
        zones.say("usb-therm", 30000 + 10 * k)
        daemon.tick()
        out = daemon.outputs
        temp, same, status, prometheus = map(content_of, (out.temp, out.same, out.status_file, out.prometheus))
        assert {number_in(each) for each in (temp, same) if each is not None} <= {28000 + 9 * k, 99000}
        assert all(each is None or each.endswith(b"\n") for each in (status, prometheus))
        assert status is None or json.loads(status)


@pytest.fixture
def small_disk(tmp_path):
    """A file system of 64 KiB; yields its folder."""
    folder = tmp_path / "disk"
    folder.mkdir()
    mount = shutil.which("mount")
    done = mount and subprocess.run([mount, "-t", "tmpfs", "-o", "size=64k", "none", folder], capture_output=True)
    if not done or done.returncode:
        pytest.skip("no file system may be mounted here")
    yield folder
    subprocess.run(["umount", "-l", folder], check=True)


def test_a_full_disk_holds_no_old_value_and_is_told_of_once(start, zones, small_disk):
    outputs = Outputs(small_disk / "out")
    daemon = start(outputs)
    newest_or_nothing(daemon, zones, 40, 1)
    descriptors = daemon.descriptors
    with open(small_disk / "filling", "wb", buffering=0) as stream, contextlib.suppress(OSError):
        while True:
            stream.write(bytes(512))
    newest_or_nothing(daemon, zones, 60, 41)
    (small_disk / "filling").unlink()
    daemon.tick()
    assert daemon.steps(3)[-1]["status"] == "tracking"
    assert daemon.descriptors == descriptors
    log = daemon.end()
    assert [line for line in log if "No space left on device" not in line and "is back" not in line] == []
    assert len(log) <= 6 * len(outputs.publish())


@pytest.mark.parametrize("removed", [True, False], ids=["removed", "renamed"])
def test_a_folder_that_goes_and_comes_back_is_published_in_again(tracking, tmp_path, removed):
    """All of it, and readers can connect again."""
    descriptors = tracking.descriptors
    folder = tracking.outputs.folder
    if removed:
        shutil.rmtree(folder)
    else:
        folder.rename(tmp_path / "elsewhere")
    for _ in range(20):
        tracking.tick()
    assert not folder.exists()
    folder.mkdir()
    assert tracking.step()["status"] == "tracking"
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as reader:
        reader.connect(str(tracking.outputs.socket))
        with reader.makefile() as lines:
            assert json.loads(lines.readline()) == tracking.outputs.status()
    tracking.tick()
    assert tracking.descriptors == descriptors
    log = tracking.end()
    gone = [line for line in log if "cannot be" in line]
    assert len(gone) == len(tracking.outputs.publish())
    assert len(log) == 2 * len(gone)
    assert [line for line in log if line.endswith("is back")] == [line for line in log if line not in gone]
    if not removed:
        for path in (tmp_path / "elsewhere").iterdir():
            assert path.name != "same" or path.read_bytes() == b"99000\n"  # who keeps it open reads the poison


@pytest.mark.parametrize("full", [False, True], ids=["its reader is gone", "its reader has stopped"])
def test_a_log_that_no_one_reads_delays_and_ends_nothing(start, zones, full):
    """The other end of its pipe is closed, as `2>&1 | head -1` does it, or its pipe is full: lines are lost."""
    reading, writing = os.pipe()
    daemon = start(log=writing)
    os.set_blocking(writing, False)
    with contextlib.suppress(BlockingIOError):
        while full:
            os.write(writing, bytes(4096))
    os.set_blocking(writing, True)
    os.close(writing)
    if not full:
        os.close(reading)
    zones.fail("battery", "EIO")
    assert daemon.steps(5)[-1]["status"] == "degraded"
    zones.heal("battery")
    assert daemon.steps(60)[-1]["status"] == "tracking"
    daemon.process.terminate()
    assert daemon.process.wait(30) == 0
    if full:
        os.close(reading)
