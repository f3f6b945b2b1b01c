"""Mode, owner and group of what the daemon creates: as configured, from the first moment, or not there at all."""

import grp
import json
import os
import pwd
import socket
import stat
import subprocess
import sys

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ambient_model.faults import Refused
from ambientd.config import load_settings, publishing_to, settings_for_model
from ambientd.publish.access import Access, grant, read_access
from ambientd.publish.spec import Spec

ME, MINE = pwd.getpwuid(os.getuid()).pw_name, grp.getgrgid(os.getgid()).gr_name
as_root = pytest.mark.skipif(os.getuid() != 0, reason="only root gives files to others")
WITHOUT_CHOWN = (
    "import ctypes, os, sys; ctypes.CDLL(None).prctl(24, 0, 0, 0, 0);"  # PR_CAPBSET_DROP, CAP_CHOWN
    "os.execv(sys.executable, [sys.executable, '-m', 'ambientd', *sys.argv[1:]])"
)


def loaded(tmp_path, text, name="c.yaml"):
    (tmp_path / name).write_text(text)
    return load_settings(str(tmp_path / name))


def refusal(tmp_path, text):
    with pytest.raises(Refused) as refused:
        loaded(tmp_path, text)
    return [str(fault) for fault in refused.value.faults]


def test_a_publication_overrides_what_holds_for_all(tmp_path):
    settings = loaded(
        tmp_path,
        f"""
model: m.json
state: {{path: state, access: {{mode: "0600"}}}}
publish:
  - stdout
  - file:/a
  - {{kind: file, path: /b, access: {{mode: "0o604", owner: 7}}}}
access: {{mode: "0640", owner: {ME}, group: "{MINE}"}}
""",
    )
    common = Access(0o640, os.getuid(), os.getgid())
    assert [spec.access for spec in settings.publish] == [Access(), common, Access(0o604, 7, os.getgid())]
    assert settings.state.access == common._replace(mode=0o600)
    specs = [Spec("stdout"), Spec("status", "/s")]
    assert [spec.access for spec in publishing_to(settings, specs).publish] == [Access(), common]
    assert settings_for_model("m").access == Access()


@pytest.mark.parametrize("written", ["0640", "640", "416", "0o1777", "'1777'", "'64'", "'0648'", "rw", "[6]", "''"])
def test_a_mode_is_octal_digits_in_quotes_and_nothing_that_could_be_misread(tmp_path, written):
    faults = refusal(tmp_path, f"model: m\naccess: {{mode: {written}}}\n")
    assert len(faults) == 1
    assert faults[0].startswith("access.mode: is ")
    assert faults[0].endswith('; octal digits in quotes, "0000" to "0777", are wanted: "0640"')


def test_every_fault_in_it_is_named(tmp_path):
    text = """
model: m
access: {owner: nobody-of-this-name, group: no-such-group, umask: 2}
publish:
  - {kind: file, path: /a, access: {owner: -2, group: 4294967295}}
  - {kind: file, path: /b, access: "0640"}
  - {kind: stdout, access: {mode: "0600"}}
  - {kind: file, path: /c, at_exit: poison, offset_millidegC: 1000000}
  - {kind: status, path: /d, at_exit: keep}
  - {kind: file, path: /e, at_exit: keep, poison_millidegC: 1}
"""
    assert refusal(tmp_path, text) == [
        "access.umask: unknown key; known are mode, owner, group",
        "access.owner: there is no user 'nobody-of-this-name' here; create the user first, or give its number",
        "access.group: there is no group 'no-such-group' here; create the group first, or give its number",
        "publish[0].access.owner: is -2; the name of a user, or its number, is wanted",
        "publish[0].access.group: is 4294967295; the name of a group, or its number, is wanted",
        "publish[1].access: is '0640'; a mapping with mode, owner and group is wanted",
        "publish[2].access: has no effect on kind 'stdout'; remove it",
        "publish[3].offset_millidegC: is 1000000; an integer in millidegrees, of at most 6 digits, is wanted",
        "publish[3].at_exit: there is no poison to leave; give poison_millidegC, too",
        "publish[4].at_exit: unknown key; known are kind, path, access",
        "publish[5].at_exit: is 'keep'; one of remove, poison is wanted",
    ]


ANYTHING = st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=6) | st.lists(st.integers())


@given(
    st.one_of(
        ANYTHING, st.dictionaries(st.sampled_from(["mode", "owner", "group", "x"]) | st.text(max_size=3), ANYTHING)
    )
)
def test_whatever_is_configured_is_an_access_or_a_fault(value):
    faults = []
    access = read_access("access", value, Access(), lambda *fault: faults.append(fault))
    assert access.mode is None or 0 <= access.mode <= 0o777
    assert -1 <= access.owner < 2**32 - 1
    assert -1 <= access.group < 2**32 - 1
    if not faults:
        assert {*value} <= {"mode", "owner", "group"}
        assert (access.mode is None) == ("mode" not in value)


def test_names_are_looked_up_only_where_there_are_some(tmp_path):
    code = (
        "import sys; from ambientd.config import load_settings; load_settings(sys.argv[1]);"
        "print({'pwd', 'grp'} & set(sys.modules))"
    )
    for access, known in (('"mode": "0600", "owner": 3', "set()"), (f'"owner": "{ME}"', "{'pwd'}")):
        (tmp_path / "c.json").write_text(f'{{"model": "m", "access": {{{access}}}}}')
        call = [sys.executable, "-S", "-c", code, str(tmp_path / "c.json")]
        environment = {"PYTHONPATH": os.pathsep.join(each for each in sys.path if each.endswith(("daemon", "shared")))}
        done = subprocess.run(call, capture_output=True, text=True, timeout=30, env=environment)
        assert (done.stdout, done.stderr) == (f"{known}\n", "")


def test_who_is_right_already_is_not_set_again(tmp_path, monkeypatch):
    """A service that runs with the group needs neither the call nor the right to it."""
    (tmp_path / "f").write_text("")
    monkeypatch.setattr(os, "chown", lambda *_: pytest.fail("called"))
    grant(str(tmp_path / "f"), Access(0o640, os.getuid(), os.getgid()))
    assert stat.S_IMODE((tmp_path / "f").stat().st_mode) == 0o640


@pytest.mark.parametrize(
    ("mode", "on_socket"),
    [(None, 0o666), (0o640, 0o660), (0o644, 0o666), (0o600, 0o600), (0o660, 0o660), (0o620, 0o620)],
)
def test_who_may_read_may_connect(mode, on_socket):
    assert Access(mode).for_socket().mode == on_socket


@pytest.fixture
def configured(tmp_path, model_file, phone):
    """A configuration that publishes every kind with an access."""
    (tmp_path / "out").mkdir()

    def write(access, **more):
        out = tmp_path / "out"
        config = {
            "model": model_file,
            "rate_hz": 20,
            "sysfs_root": str(phone.root),
            "state": {"path": f"{out}/state"},
            "publish": [
                f"file:{out}/temp",
                {"kind": "file", "path": f"{out}/same", "mode": "in-place"},
                f"status:{out}/status",
                f"prometheus:{out}/a.prom",
                f"socket:{out}/s",
                {"kind": "status", "path": f"{tmp_path}/own", "access": {"owner": os.getuid(), "group": os.getgid()}},
            ],
            "access": access,
            **more,
        }
        (tmp_path / "c.json").write_text(json.dumps(config))
        return tmp_path / "c.json"

    return write


NAMES = ("temp", "same", "status", "a.prom", "s", "state")


@as_root
def test_everything_that_is_created_is_whose_it_should_be(start, until, ended, configured, tmp_path):
    config = configured({"mode": "0640", "owner": 4711, "group": 4712})
    daemon = start("run", "--config", config)
    out = tmp_path / "out"
    until(lambda: {*os.listdir(out)} >= {*NAMES})
    for name in NAMES:
        found = (out / name).stat()
        mode = 0o660 if name == "s" else 0o640
        assert (stat.S_IMODE(found.st_mode), found.st_uid, found.st_gid) == (mode, 4711, 4712), name
    own = (tmp_path / "own").stat()
    assert (stat.S_IMODE(own.st_mode), own.st_uid) == (0o640, os.getuid())
    assert ended(daemon)[0] == 0
    assert os.listdir(out) == ["state"]


@as_root
def test_without_the_right_to_give_files_away_each_outlet_fails_alone(until, ended, configured, tmp_path):
    config = configured({"owner": 4711})
    call = [sys.executable, "-c", WITHOUT_CHOWN, "run", "--config", str(config)]
    daemon = subprocess.Popen(call, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        until((tmp_path / "own").exists)
        said = (tmp_path / "own").read_text()
        until(lambda: (tmp_path / "own").read_text() not in ("", said))
        assert os.listdir(tmp_path / "out") == []  # nothing that anyone could read who should not
        status, _, log = ended(daemon)
    finally:
        daemon.kill()
        daemon.communicate()
    assert status == 0
    out = tmp_path / "out"
    kinds = (f"file:{out}/temp", f"file-in-place:{out}/same", f"status:{out}/status", f"prometheus:{out}/a.prom")
    failed = "cannot be written (Operation not permitted); the"
    assert sorted(log.splitlines()[1:]) == sorted(
        [
            *(f"ambientd: {name}: {failed} others go on" for name in (*kinds, f"socket:{out}/s")),
            f"ambientd: state {out}/state: {failed} rest goes on",
        ]
    )


@as_root
def test_check_tells_before_start_what_could_not_be_given_away(configured, ambientd, tmp_path):
    config = configured({"mode": "0640", "owner": 4711})
    out = tmp_path / "out"
    done = ambientd("check", "--config", config)
    assert (done.returncode, done.stderr) == (0, "")
    said = [each for each in done.stdout.splitlines() if each.startswith("output")]
    given = f"user 4711, group {os.getgid()}"
    assert said == [
        f"output       file:{out}/temp: 0640, {given}",
        f"output       file-in-place:{out}/same: 0640, {given}",
        f"output       status:{out}/status: 0640, {given}",
        f"output       prometheus:{out}/a.prom: 0640, {given}",
        f"output       socket:{out}/s: 0660, {given}",
        f"output       status:{tmp_path}/own: 0640, user {os.getuid()}, group {os.getgid()}",
        f"output       state:{out}/state: 0640, {given}",
    ]
    assert os.listdir(out) == []
    call = [sys.executable, "-c", WITHOUT_CHOWN, "check", "--config", str(config)]
    done = subprocess.run(call, capture_output=True, text=True, timeout=30)
    assert done.returncode == 1
    lines = done.stderr.splitlines()
    assert lines[0] == f"ambientd: {config}: 6 faults"
    assert lines[1] == (
        f"  output file:{out}/temp: cannot be written (Operation not permitted); let the daemon run with that group, or"
        " with CAP_CHOWN and, under systemd, SystemCallFilter=@chown; and check as the user that it runs as"
    )
    assert os.listdir(out) == []


def test_check_tells_of_every_output_and_sensor_that_would_fail(configured, ambientd, phone, tmp_path):
    out = tmp_path / "out"
    (out / "folder").mkdir()
    (out / "no-socket").write_text("")
    (phone.root / "class/thermal/thermal_zone3/temp").unlink()
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as other:
        other.bind(str(out / "there"))
    publish = [
        f"file:{out}/folder",
        f"socket:{out}/no-socket",
        f"socket:{out}/{'x' * 120}",
        f"socket:{out}/there",
        f"status:{tmp_path}/later/status",
        f"file:{out}/good",
    ]
    done = ambientd("check", "--config", configured({}, publish=publish))
    assert done.returncode == 1
    assert f"output       status:{tmp_path}/later/status: {tmp_path}/later is not there; it must be" in done.stdout
    assert f"output       socket:{out}/there: there is a socket already" in done.stdout
    assert f"output       file:{out}/good: 0644, user" in done.stdout
    lines = done.stderr.splitlines()
    assert lines[0] == f"ambientd: {tmp_path}/c.json: 4 faults"
    assert lines[1].startswith("  sensor battery: ")
    mend = "choose another path, or see that the user that the daemon runs as may write there, and check as that user"
    assert lines[2:] == [
        f"  output file:{out}/folder: cannot be written (it is a folder); {mend}",
        f"  output socket:{out}/no-socket: cannot be written (it exists and is no socket); {mend}",
        f"  output socket:{out}/{'x' * 120}: cannot be written (its path is longer than 107 bytes); {mend}",
    ]
    assert sorted(os.listdir(out)) == ["folder", "no-socket", "there"]


@as_root
def test_a_reload_changes_it_without_a_gap_and_lets_readers_be(start, until, ended, configured, tmp_path):
    out = tmp_path / "out"
    daemon = start("run", "--config", configured({"mode": "0600"}))
    until(lambda: {*os.listdir(out)} >= {*NAMES})
    inode = (out / "same").stat().st_ino
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as reader:
        reader.settimeout(10)
        reader.connect(f"{out}/s")
        lines = reader.makefile()
        lines.readline()
        configured({"mode": "0640", "group": 4712})
        os.kill(daemon.pid, 1)

        def changed():
            lines.readline()
            found = [(stat.S_IMODE((out / name).stat().st_mode), (out / name).stat().st_gid) for name in NAMES[:-1]]
            return found == [(0o640, 4712)] * 4 + [(0o660, 4712)]

        until(changed)
    assert (out / "same").stat().st_ino == inode
    assert ended(daemon)[0] == 0
