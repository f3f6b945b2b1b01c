"""Each command of deploy/README.md runs: the installation here, the others in the tests that stand beside them."""

import re
import shlex
import sys
from pathlib import Path

import pytest

from processes import ran

ROOT = Path(__file__).resolve().parents[2]
README = (ROOT / "deploy" / "README.md").read_text()
HERE = ("deploy/test_readme.py", "ran(*words")
RUN_IN = {
    "python3 -m venv": HERE,
    "/opt/ambientd/bin/pip install": HERE,
    "ln -s /opt": HERE,
    "systemd-sysusers": ("deploy/test_deb.py", '"dpkg", "-i"'),  # whose postinst runs it
    "ambientd check": ("deploy/test_deb.py", '"ambientd", "check", "--config", "/etc/ambientd/ambientd.yaml"'),
    "systemctl daemon-reload": ("deploy/test_under_systemd.py", '"systemctl", "daemon-reload"'),
    "systemctl enable": ("deploy/test_deb.py", '"systemctl", "enable", "--now", "ambientd"'),
    "systemctl reload": ("deploy/test_under_systemd.py", '"systemctl", "reload", "ambientd"'),
    "ambientd watch": ("ambientd/test_watch.py", '"watch"'),
    "python3 deploy/build_zipapp.py": ("deploy/conftest.py", '"build_zipapp.py", "-o"'),
    "python3 -I -S ambientd.pyz check": ("deploy/test_zipapp.py", 'str(path), "check", "--model"'),
    "build_zipapp.py --compiled": ("deploy/test_zipapp.py", '"--compiled"'),
    "python3 deploy/build_deb.py": ("deploy/test_deb.py", '"build_deb.py"'),
    "apt install": ("deploy/test_deb.py", '"dpkg", "-i"'),
    "cp model.json": ("deploy/test_deb.py", "model.json"),
    "ambientd withdraw": ("deploy/test_under_systemd.py", '"kill", "-KILL"'),  # after which the unit runs it
}
"""By how a command begins, the test that runs it, or what it runs, and how that stands there."""


def commands() -> list[str]:
    blocks = "".join(re.findall(r"^ *```\n(.*?)^ *```$", README, re.M | re.S)).splitlines()
    programs = r"(?:python3|pip|ambientd|systemctl|systemd-sysusers|build_zipapp\.py|apt|cp|ln) ?[a-z-]*[^`]*"
    inline = re.findall(rf"`((?:{programs}))`", re.sub(r"```.*?```", "", README, flags=re.S))
    return [line.strip() for line in blocks] + [each for each in inline if " " in each or each == "systemd-sysusers"]


@pytest.mark.parametrize("command", commands())
def test_each_command_runs_somewhere(command):
    [(file, call)] = {where for start, where in RUN_IN.items() if command.startswith(start)}
    assert call in (ROOT / "tests" / file).read_text()


def test_it_stays_short():
    assert len(README.encode()) <= 8192


@pytest.mark.slow
def test_the_installation_as_it_is_written(tmp_path):
    """In a folder of the test's own in place of /opt and /usr/local."""
    block = re.search(r"```\n(.*?)```", README, re.S)[1]
    (tmp_path / "bin").mkdir()
    for line in block.replace("/opt", f"{tmp_path}/opt").replace("/usr/local", str(tmp_path)).splitlines():
        words = shlex.split(line)
        words[:1] = [sys.executable] if words[:1] == ["python3"] else words[:1]
        done = ran(*words, cwd=ROOT, status=None if "pip" in line else 0, timeout=300) if words else None
        if done and done.returncode:
            pytest.skip(f"no package index here: {done.stderr[-200:]}")
    assert ran(tmp_path / "bin" / "ambientd", "--version").stdout.strip()
    shown = ran(tmp_path / "opt/ambientd/bin/pip", "show", "ambientd").stdout.splitlines()
    assert "Requires:" in map(str.strip, shown), "the device is asked for nothing beside"
