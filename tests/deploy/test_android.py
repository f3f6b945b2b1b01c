"""Android, as far as that goes without one: init's command runs, the policy compiles, the module holds and starts."""

import json
import os
import re
import shutil
import signal
import stat
import sys
import zipfile
from pathlib import Path

import pytest

from processes import ran, under

DEPLOY = Path(__file__).resolve().parents[2] / "deploy"
ANDROID = DEPLOY / "android"

# What of Android's policy the daemon's own names: classes, attributes and types, under a minimal MLS policy.
BEFORE = """
class process class file class dir class lnk_file class sock_file class unix_stream_socket
sid kernel
common file { getattr setattr open read write lock execute map create rename unlink }
class process { transition siginh rlimitinh noatsecure }
class file inherits file { entrypoint }
class dir inherits file { search add_name remove_name }
class lnk_file inherits file
class sock_file inherits file
class unix_stream_socket { create bind listen accept connect connectto getattr getopt setopt read write }
sensitivity s0;
dominance { s0 }
category c0;
level s0:c0;
mlsconstrain file read (l1 dom l2);
attribute domain; attribute exec_type; attribute vendor_file_type; attribute file_type; attribute dev_type;
type init, domain; type hal_thermal_default, domain; type hal_sensors_default, domain;
type vendor_file, vendor_file_type, file_type; type sysfs; type sysfs_thermal; type sysfs_batteryinfo; type device;
"""
AFTER = """
neverallow ambientd self:process transition;
neverallow { domain -ambientd } ambientd_run:file write;
neverallow * { file_type -exec_type -vendor_file_type }:sock_file create;
neverallow ambientd ~{ dev_type ambientd_exec vendor_file sysfs sysfs_thermal sysfs_batteryinfo }:file { read write };
role r;
role r types domain;
user u roles r level s0 range s0 - s0:c0;
sid kernel u:r:init:s0
"""


def test_the_policy_compiles_and_the_labels_are_its_types(program, tmp_path):
    source, compiled = tmp_path / "policy.conf", tmp_path / "policy"
    source.write_text(BEFORE + (ANDROID / "ambientd.te").read_text() + AFTER)
    ran(program("checkpolicy"), "-M", "-E", "-o", compiled, source)
    compile_labels = program("sefcontext_compile"), "-p", compiled, "-o", tmp_path / "bin"
    assert ran(*compile_labels, ANDROID / "file_contexts").stderr == ""


def service():
    """The words of init's service line, and its options by their first word."""
    lines = (ANDROID / "ambientd.rc").read_text().splitlines()
    start = next(number for number, line in enumerate(lines) if line.startswith("service "))
    return lines[start].split()[2:], dict(line.split(maxsplit=1) for line in lines[start + 1 :])


def test_what_is_labelled_is_what_init_makes_and_starts():
    words, options = service()
    assert options == {"class": "main", "user": "system", "group": "system"}
    labels = [line.split() for line in (ANDROID / "file_contexts").read_text().splitlines()]
    named = {context: pattern for pattern, context in labels}
    assert re.fullmatch(named["u:object_r:ambientd_exec:s0"], words[0])
    made = re.findall(r"^    mkdir (\S+) 0755 system system$", (ANDROID / "ambientd.rc").read_text(), re.MULTILINE)
    assert made == ["/dev/ambientd"]
    file, *others = json.loads((ANDROID / "ambientd.json").read_text())["publish"]
    for target in (made[0], file["path"], *(each.partition(":")[2] for each in others)):
        assert re.fullmatch(named["u:object_r:ambientd_run:s0"], target)


def laid_out(folder, run, zipapp, model_file):
    """The files that an integrator puts beside each other, publishing under ``run``."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "bin").mkdir()
    (folder / "bin" / "python3").symlink_to(sys.executable)
    shutil.copy(zipapp, folder / "ambientd.pyz")
    shutil.copy(model_file, folder / "model.json")
    (folder / "ambientd.json").write_text((ANDROID / "ambientd.json").read_text().replace("/dev/ambientd", str(run)))


def test_the_service_line_runs(zipapp, model_file, phone, spawn, until, tmp_path):
    """Init's own words, with the folders of a phone moved under the test's."""
    run = tmp_path / "run"
    run.mkdir()
    laid_out(tmp_path / "vendor", run, zipapp, model_file)
    words = [word.replace("/vendor/ambientd", str(tmp_path / "vendor")) for word in service()[0]]
    daemon = spawn([*words, "--sysfs-root", str(phone)], env={}, cwd="/")
    until(lambda: (run / "ambient_temp").exists())
    assert (run / "ambient_temp").read_text() == "23000\n"
    assert stat.S_ISSOCK((run / "ambient.sock").stat().st_mode)
    daemon.terminate()
    assert daemon.wait(timeout=20) == 0
    assert os.listdir(run) == ["ambient_temp"]
    assert (run / "ambient_temp").read_text() == "60000\n"


@pytest.fixture(scope="module")
def module(build, tmp_path_factory):
    path = tmp_path_factory.mktemp("magisk") / "ambientd-magisk.zip"
    build("build_magisk.py", "-o", path)
    return path


@pytest.fixture
def keeper(installed, spawn, program, tmp_path):
    """The module's service, started by a shell in folders of the test's own, with settings in a folder."""

    def start(settings, shell="sh"):
        moved = {"AMBIENTD_SETTINGS": str(settings), "AMBIENTD_RUN": str(tmp_path / "run"), "AMBIENTD_PAUSE_S": "0.1"}
        return spawn([program(shell), installed / "service.sh"], env={"PATH": os.environ["PATH"], **moved})

    return start


@pytest.fixture
def installed(module, tmp_path):
    """The module, unpacked."""
    with zipfile.ZipFile(module) as archive:
        archive.extractall(tmp_path / "module")
    return tmp_path / "module"


def test_the_module_holds_the_same_daemon(module, zipapp):
    with zipfile.ZipFile(module) as archive:
        assert archive.read("ambientd.pyz") == zipapp.read_bytes()
        assert sorted(archive.namelist()) == [
            "META-INF/com/google/android/update-binary",
            "META-INF/com/google/android/updater-script",
            *("ambientd.json", "ambientd.pyz", "customize.sh", "module.prop", "service.sh"),
        ]


@pytest.mark.parametrize("shell", ["sh", "mksh"])
def test_the_module_keeps_the_daemon_running_until_it_is_disabled(
    shell, installed, model_file, phone, keeper, until, tmp_path
):
    """Unpacked and started as Magisk does, by Debian's shell and by Android's; the daemon is killed once."""
    settings, run = tmp_path / "settings", tmp_path / "run"
    laid_out(settings / "python", run, installed / "ambientd.pyz", model_file)
    for name in ("model.json", "ambientd.json"):
        (settings / "python" / name).rename(settings / name)
    configuration = json.loads((settings / "ambientd.json").read_text())
    (settings / "ambientd.json").write_text(json.dumps({**configuration, "sysfs_root": str(phone)}))
    keeper = keeper(settings, shell)
    published = run / "ambient_temp"
    until(published.exists)
    assert published.read_text() == "23000\n"

    def daemon():
        return [pid for pid, words in under(keeper.pid, "cmdline").items() if "ambientd.pyz run" in " ".join(words)]

    (first,) = daemon()
    os.kill(first, signal.SIGKILL)
    until(lambda: published.read_text() == "60000\n", "the last value stays")
    until(lambda: daemon() not in ([first], []), "it was not started again")
    until(lambda: "ambientd: model 'phone'" in (run / "log").read_text())
    (installed / "disable").touch()
    (second,) = daemon()
    os.kill(second, signal.SIGTERM)
    assert keeper.wait(timeout=20) == 0
    assert "ambientd ended with status 0" in (run / "log").read_text()
    assert published.read_text() == "60000\n"


def test_the_module_without_a_python_says_so(installed, keeper, until, tmp_path):
    keeper = keeper(tmp_path)
    log = tmp_path / "run" / "log"
    until(lambda: log.exists() and log.read_text())
    said = f"no Python in {tmp_path}/python/bin/python3 nor in Termux; looking again in 0.1 s\n"
    until(lambda: log.read_text() == said)
    (installed / "remove").touch()
    assert keeper.wait(timeout=20) == 0


def test_the_installation_keeps_the_settings_that_are_there(installed, tmp_path):
    """customize.sh, sourced as Magisk does, with its folder moved: an update changes nothing that is the user's."""
    script = (installed / "customize.sh").read_text().replace("/data/adb/ambientd", f"{tmp_path}/settings")
    call = ["sh", "-euc", f'ui_print() {{ echo "$1"; }}; MODPATH={installed}\n{script}']
    first = ran(*call)
    assert first.stderr == ""
    assert first.stdout == f"- copy your model to {tmp_path}/settings/model.json, then restart\n"
    kept = tmp_path / "settings" / "ambientd.json"
    assert kept.read_text() == (ANDROID / "ambientd.json").read_text()
    kept.write_text("mine")
    (tmp_path / "settings" / "model.json").write_text("mine")
    assert (ran(*call).stdout, kept.read_text()) == ("", "mine")


def test_shellcheck_has_nothing_to_say(program):
    scripts = [*sorted(DEPLOY.rglob("*.sh")), DEPLOY / "magisk/META-INF/com/google/android/update-binary"]
    scripts += [DEPLOY / "debian" / name for name in ("postinst", "prerm", "postrm")]
    assert {"emul_temp.sh", "service.sh", "customize.sh"} <= {script.name for script in scripts}
    assert ran(program("shellcheck"), *scripts).stdout == ""
