"""The unit: valid, closed as far as systemd can measure, and no tighter than what the daemon does."""

import re
from pathlib import Path

import pytest

from processes import ran

DEPLOY = Path(__file__).resolve().parents[2] / "deploy"
UNIT = DEPLOY / "ambientd.service"
MOST_EXPOSURE = 1.5


@pytest.fixture
def analyze(program):
    """Run systemd-analyze; no running systemd is needed."""
    return lambda *arguments: ran(program("systemd-analyze"), "--no-pager", *arguments, status=None)


def test_systemd_finds_nothing_wrong(analyze):
    done = analyze("verify", UNIT)
    if "Failed to initialize path lookup" in done.stderr or "Operation not permitted" in done.stderr:
        pytest.skip(f"systemd-analyze verify does not work here: {done.stderr.strip()}")
    assert (done.returncode, done.stderr) == (0, "")


def test_its_exposure_is_low(analyze):
    done = analyze("security", "--offline=true", f"--threshold={round(MOST_EXPOSURE * 10)}", UNIT)
    if "unrecognized option" in done.stderr:
        pytest.skip("this systemd-analyze is older than 250 and cannot judge a file")
    found = re.search(r"Overall exposure level for ambientd\.service: ([\d.]+)", done.stdout)
    assert found, done.stderr
    assert float(found[1]) <= MOST_EXPOSURE
    assert done.returncode == 0


def test_what_thermald_waits_for_is_what_it_reads_and_the_wait_ends(analyze, tmp_path):
    """The drop-in makes a valid unit of a stand-in for thermald's."""
    drop_in = DEPLOY / "thermald" / "ambientd.conf"
    assert "[ -s /run/ambientd/ambient_temp ]" in drop_in.read_text()
    (tmp_path / "thermald.service.d").mkdir()
    (tmp_path / "thermald.service.d" / "ambientd.conf").write_text(drop_in.read_text())
    (tmp_path / "thermald.service").write_text("[Service]\nExecStart=/bin/true\n")
    (tmp_path / "ambientd.service").write_text(UNIT.read_text())
    done = analyze("verify", tmp_path / "thermald.service")
    assert (done.returncode, done.stderr) == (0, "")
