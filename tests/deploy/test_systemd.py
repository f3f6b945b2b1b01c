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

    def run(*arguments):
        return ran(program("systemd-analyze"), "--no-pager", *arguments, status=None)

    return run


@pytest.fixture
def unit():
    """The unit's [Service] section, a list of values per key."""
    lines = [line for line in UNIT.read_text().splitlines() if "=" in line and not line.startswith("#")]
    values: dict[str, list[str]] = {}
    for key, value in (line.split("=", 1) for line in lines):
        values.setdefault(key, []).append(value)
    return values


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


def allowed_calls(analyze, filters):
    """The system calls that the unit's SystemCallFilter lines leave, as systemd expands its groups."""

    def expanded(name):
        if not name.startswith("@"):
            return {name}
        listed = [line.strip() for line in analyze("syscall-filter", name).stdout.splitlines()[1:]]
        return set().union(*[expanded(each) for each in listed if each and not each.startswith("#")])

    calls: set[str] = set()
    for line in filters:
        names = set().union(*[expanded(name) for name in line.removeprefix("~").split()])
        calls = calls - names if line.startswith("~") else calls | names
    # systemd always lets these through, so that the program can be started at all
    return calls | expanded("@default") | {"execve"}


def test_the_daemon_makes_no_system_call_that_the_unit_forbids(analyze, program, unit, deployed, tmp_path, model_file):
    """EPERM for a call on a path that is taken once a month would end a daemon that ran well on the bench."""
    trace = tmp_path / "trace.csv"
    trace.write_text("time_s,usb_degC,battery_degC\n0,25,25\n1,,25\n2,25,25\n")
    kinds = ("file", "file-in-place", "status", "prometheus", "socket")
    publish = [part for kind in kinds for part in ("--publish", f"{kind}:{tmp_path}/{kind}")]
    words = deployed("run", "--model", model_file, "--replay", trace, "--rate", "20", *publish)
    done = ran(program("strace"), "-f", "-o", tmp_path / "calls", *words, env={}, status=None)
    if "ptrace" in done.stderr:
        pytest.skip(f"strace may not trace here: {done.stderr.strip()}")
    assert done.returncode == 0, done.stderr
    made = set(re.findall(r"^\d+ +(\w+)\(", (tmp_path / "calls").read_text(), re.MULTILINE))
    assert {"pread64", "rename"} & made
    assert made - allowed_calls(analyze, unit["SystemCallFilter"]) == set()
