"""The bridge to a kernel zone, run by each shell that is here, on a fake sysfs that hears every write."""

import contextlib
import os
import signal
from pathlib import Path

import pytest

from device import add_zone

SCRIPT = Path(__file__).resolve().parents[2] / "deploy" / "qualcomm" / "emul_temp.sh"


class Zone:
    """A kernel zone that keeps all that is written to its emul_temp."""

    def __init__(self, sysfs: Path) -> None:
        for number, kind in enumerate(["battery", "xo-therm", "quiet-therm"]):
            folder = add_zone(sysfs, number, kind)
        os.mkfifo(folder / "emul_temp")
        self.descriptor = os.open(folder / "emul_temp", os.O_RDWR | os.O_NONBLOCK)
        self.heard: list[str] = []

    def says(self) -> str:
        """The newest value; "" where none was written yet."""
        with contextlib.suppress(BlockingIOError):
            self.heard += os.read(self.descriptor, 65536).decode().splitlines()
        return self.heard[-1] if self.heard else ""


@pytest.fixture
def zone(tmp_path):
    made = Zone(tmp_path / "sys")
    yield made
    os.close(made.descriptor)


@pytest.fixture
def bridge(tmp_path, program, spawn):
    return lambda *arguments, shell="sh": spawn(
        [program(shell), str(SCRIPT), *map(str, arguments)],
        env={"PATH": os.environ["PATH"], "SYSFS_ROOT": str(tmp_path / "sys")},
    )


def put(path, text, age_s=0):
    """Publish as the daemon does, by rename."""
    part = path.with_suffix(".part")
    part.write_text(text)
    if age_s:
        then = part.stat().st_mtime - age_s
        os.utime(part, (then, then))
    part.replace(path)


@pytest.mark.parametrize("shell", ["sh", "mksh"])
def test_the_zone_says_what_is_published_and_never_0(shell, bridge, zone, until, tmp_path):
    """By Debian's shell, and by Android's."""
    estimate = tmp_path / "ambient_temp"
    put(estimate, "23400\n")
    process = bridge(estimate, "quiet-therm", 60000, 0.02, shell=shell)
    until(lambda: zone.says() == "23400")
    for published, said in [
        ("0\n", "1"),
        ("-5000\n", "-5000"),
        ("-0\n", "1"),
        ("31200\n", "31200"),
        ("000\n", "1"),
        ("nan\n", "60000"),
        ("26.5\n", "60000"),
        ("31201\n", "31201"),
        ("", "60000"),
        ("9999999999999999999999\n", "60000"),
        ("-32000\n", "-32000"),
    ]:
        put(estimate, published)
        until(lambda said=said: zone.says() == said, f"{published!r} is not said as {said}")
    for age_s, value in ((3600, 20000), (-86400, 20010)):
        put(estimate, f"{value}\n", age_s=age_s)
        until(lambda: zone.says() == "60000", "an estimate of another time is still said")
        put(estimate, f"{value}\n")
        until(lambda value=value: zone.says() == f"{value}")
    estimate.unlink()
    until(lambda: zone.says() == "60000")
    put(estimate, "20001\n")
    until(lambda: zone.says() == "20001")
    process.send_signal(signal.SIGTERM)
    said, _ = process.communicate(timeout=15)
    assert (process.returncode, said) == (0, "")
    assert zone.says() == "60000", "the last value is left standing"
    assert not any(int(each) == 0 for each in zone.heard)


@pytest.mark.parametrize(
    ("arguments", "status", "message"),
    [
        ((), 2, "usage: emul_temp.sh ESTIMATE ZONE_TYPE MISSING_MILLIDEGC [PERIOD_S]"),
        (("f", "quiet-therm", "0"), 2, "MISSING_MILLIDEGC is 0, which would switch the emulation off; choose another"),
        (("f", "quiet-therm", "x"), 2, "MISSING_MILLIDEGC is 'x'; an integer in millidegrees is wanted"),
        (("f", "quiet-therm", "60000", "0"), 2, "PERIOD_S is '0'; more than 0 is wanted"),
        (("f", "quiet-therm", "60000", "1s"), 2, "PERIOD_S is '1s'; a number of seconds is wanted"),
        (("f", "none", "60000"), 1, "no thermal zone of type 'none'"),
    ],
)
def test_a_call_that_cannot_be_done_is_told(bridge, zone, arguments, status, message):
    process = bridge(*arguments)
    said, _ = process.communicate(timeout=15)
    assert (process.returncode, said) == (status, f"emul_temp: {message}\n")
    assert zone.says() == ""
