"""The Debian package: built twice alike, understood by dpkg, and installed, run, upgraded and purged for real."""

import filecmp
import re
import shutil
from pathlib import Path

import pytest

from processes import ran

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def deb(build, tmp_path_factory):
    path = tmp_path_factory.mktemp("deb") / "ambientd.deb"
    build("build_deb.py", "-o", path, "--maintainer", "Jane Doe <jane@example.com>")
    return path


def test_dpkg_understands_it(program, deb):
    def dpkg_deb(*words):
        return ran(program("dpkg-deb"), *words).stdout

    fields = dict(line.split(": ", 1) for line in dpkg_deb("-f", deb).splitlines() if not line.startswith(" "))
    version = re.search(r'__version__ = "(.+)"', (ROOT / "shared/ambient_model/__init__.py").read_text())[1]
    assert (fields["Package"], fields["Version"], fields["Architecture"]) == ("ambientd", version, "all")
    assert fields["Depends"] == "python3 (>= 3.10), python3-yaml, init-system-helpers (>= 1.52)"
    assert "./usr/bin/ambientd" in dpkg_deb("-c", deb)
    assert dpkg_deb("-I", deb, "conffiles") == "/etc/ambientd/ambientd.yaml\n"


@pytest.mark.slow
def test_lintian_finds_nothing(program, deb):
    done = ran(program("lintian"), "--allow-root", deb, status=None, timeout=120)
    mine = "bogus-mail-host"  # example.com
    assert not [line for line in done.stdout.splitlines() if line[:2] in ("E:", "W:") and mine not in line]


def test_it_is_installed_started_upgraded_removed_and_purged(boot, program, at_rest, deb, tmp_path, model_file):
    for package in ("python3", "python3-yaml"):
        asked = ran(program("dpkg-query"), "-W", "-f", "${Status}", package, status=None)
        if not asked.stdout.startswith("install ok installed"):
            pytest.skip(f"{package}, which the package depends on, is not installed")
    at_rest(tmp_path / "files/etc/ambientd/sys")
    shutil.copy(deb, tmp_path / "ambientd.deb")
    with boot(tmp_path) as machine:
        machine.run("dpkg", "-i", "/box/ambientd.deb")
        assert machine.show("ActiveState") == "inactive", "there is no model yet"
        # what the guide says comes next
        machine.file("/etc/ambientd/model.json").write_text(model_file.read_text())
        configuration = machine.file("/etc/ambientd/ambientd.yaml")
        configuration.write_text(configuration.read_text().replace("sysfs_root: /sys", "sysfs_root: sys"))
        assert "usb" in machine.run("ambientd", "check", "--config", "/etc/ambientd/ambientd.yaml")
        machine.run("systemctl", "enable", "--now", "ambientd")
        assert machine.file("/run/ambientd/ambient_temp").read_text() == "23000\n"
        process = machine.show("MainPID")

        machine.run("dpkg", "-i", "/box/ambientd.deb")
        assert machine.show("ActiveState") == "active"
        assert machine.show("MainPID") != process, "the old one goes on with the old files"
        assert "sysfs_root: sys" in configuration.read_text(), "a configuration that was changed is kept"

        machine.run("dpkg", "-r", "ambientd")
        assert not machine.file("/usr/bin/ambientd").exists()
        assert not machine.file("/run/ambientd").exists()
        assert not machine.file("/etc/systemd/system/multi-user.target.wants/ambientd.service").is_symlink()
        assert machine.file("/var/lib/ambientd/state.json").exists()
        machine.run("dpkg", "-P", "ambientd")
        assert not machine.file("/var/lib/ambientd").exists()
        assert not configuration.exists()
        assert machine.file("/etc/ambientd/model.json").exists(), "that is the user's"
    assert filecmp.cmp(deb, tmp_path / "ambientd.deb", shallow=False)
    assert not Path("/usr/lib/systemd/system/ambientd.service").exists(), "it was installed on this very machine"
