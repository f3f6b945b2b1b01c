"""Mode, owner and group of what the daemon creates: as configured, from the first moment, or not there at all."""

import grp
import os
import pwd
import socket
import stat

import pytest

from ambientd.config import load_settings, publishing_to, settings_for_model
from ambientd.publish.access import Access, grant
from ambientd.publish.spec import Spec
from refusals import refused, refused_places

ME, MINE = pwd.getpwuid(os.getuid()).pw_name, grp.getgrgid(os.getgid()).gr_name
as_root = pytest.mark.skipif(os.getuid() != 0, reason="only root gives files to others")
WITHOUT_CHOWN = (
    "import ctypes, os, sys; ctypes.CDLL(None).prctl(24, 0, 0, 0, 0);"  # PR_CAPBSET_DROP, CAP_CHOWN
    "os.execv(sys.executable, [sys.executable, '-m', 'ambientd', *sys.argv[1:]])"
)


@pytest.fixture
def loaded(write):
    return lambda text: load_settings(write("c.yaml", f"model: m.json\n{text}"))


def test_a_publication_overrides_what_holds_for_all(loaded):
    settings = loaded(f"""
state: {{path: state, access: {{mode: "0600"}}}}
publish: [stdout, "file:/a", {{kind: file, path: /b, access: {{mode: "0o604", owner: 7}}}}]
access: {{mode: "0640", owner: {ME}, group: "{MINE}"}}
""")
    common = Access(0o640, os.getuid(), os.getgid())
    assert [spec.access for spec in settings.publish] == [Access(), common, Access(0o604, 7, os.getgid())]
    assert settings.state.access == common._replace(mode=0o600)
    specs = [Spec("stdout"), Spec("status", "/s")]
    assert [spec.access for spec in publishing_to(settings, specs).publish] == [Access(), common]
    assert settings_for_model("m").access == Access()
    assert "/s is duplicated" in str(refused(publishing_to, settings, [*specs, Spec("file", "/./s")]))


@pytest.mark.parametrize("written", ["0640", "640", "416", "0o1777", "'1777'", "'64'", "'0648'", "rw", "[6]", "''"])
def test_a_mode_is_octal_digits_in_quotes_and_nothing_that_could_be_misread(loaded, written):
    assert refused_places(loaded, f"access: {{mode: {written}}}\n") == ["access.mode"]


def test_every_fault_in_it_is_named(loaded):
    text = """
access: {owner: nobody-of-this-name, group: no-such-group, umask: 2}
publish:
  - {kind: file, path: /a, access: {owner: -2, group: 4294967295}}
  - {kind: file, path: /b, access: "0640"}
  - {kind: stdout, access: {mode: "0600"}}
  - {kind: file, path: /c, at_exit: poison, offset_millidegC: 1000000}
  - {kind: status, path: /d, at_exit: keep}
  - {kind: file, path: /e, at_exit: keep, poison_millidegC: 1}
"""
    assert refused_places(loaded, text) == [
        *("access.umask", "access.owner", "access.group"),
        *("publish[0].access.owner", "publish[0].access.group", "publish[1].access", "publish[2].access"),
        *("publish[3].offset_millidegC", "publish[3].at_exit", "publish[4].at_exit", "publish[5].at_exit"),
    ]


def test_an_owner_that_is_right_is_not_set_again(tmp_path, monkeypatch):
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
def out(tmp_path):
    (tmp_path / "out").mkdir()
    return tmp_path / "out"


@pytest.fixture
def configured(tmp_path, out, configure):
    """A configuration that publishes every kind with an access."""

    def write(access, **more):
        mine = {"owner": os.getuid(), "group": os.getgid()}
        publish = [f"file:{out}/temp", {"kind": "file", "path": f"{out}/same", "mode": "in-place"}]
        publish += [f"status:{out}/status", f"prometheus:{out}/a.prom", f"socket:{out}/s"]
        publish += [{"kind": "status", "path": f"{tmp_path}/own", "access": mine}]
        return configure(**{"publish": publish, "access": access, "state": {"path": f"{out}/state"}, **more})

    return write


NAMES = ("temp", "same", "status", "a.prom", "s", "state")


def accesses(folder, names=NAMES):
    found = [(folder / name).stat() for name in names]
    return [(stat.S_IMODE(each.st_mode), each.st_uid, each.st_gid) for each in found]


@as_root
def test_everything_is_created_as_configured_and_a_reload_changes_it_without_a_gap(
    start, until, ended, configured, listen, out, tmp_path
):
    daemon = start("run", "--config", configured({"mode": "0640", "owner": 4711, "group": 4712}))
    until(lambda: {*os.listdir(out)} >= {*NAMES})
    assert accesses(out) == [(0o660 if name == "s" else 0o640, 4711, 4712) for name in NAMES]
    assert accesses(tmp_path, ["own"]) == [(0o640, os.getuid(), os.getgid())]
    inode = (out / "same").stat().st_ino
    lines = listen(out / "s")
    configured({"mode": "0644", "group": 4713})
    os.kill(daemon.pid, 1)

    def changed():
        lines.readline()  # the reader stays
        return {(mode, group) for mode, _, group in accesses(out, NAMES[:4])} == {(0o644, 4713)}

    until(changed)
    assert (out / "same").stat().st_ino == inode
    assert ended(daemon)[0] == 0
    assert os.listdir(out) == ["state"]


@as_root
def test_check_reports_before_the_start_what_could_not_be_given_away(configured, ambientd, out):
    config = configured({"mode": "0640", "owner": 4711})
    done = ambientd("check", "--config", config)
    assert done.stderr == ""
    said = [each.split(": ")[1] for each in done.stdout.splitlines() if each.startswith("output")]
    user, group = f"user {os.getuid()}", f"group {os.getgid()}"
    given = [f"{mode}, user 4711, {group}" for mode in ("0640", "0640", "0640", "0640", "0660")]
    assert said == [*given, f"0640, {user}, {group}", f"0640, user 4711, {group}"]
    done = ambientd("check", "--config", config, by=("-c", WITHOUT_CHOWN), status=1)
    assert done.stderr.count("(Operation not permitted)") == 6
    assert "CAP_CHOWN" in done.stderr
    assert os.listdir(out) == []


def test_check_reports_every_output_that_would_fail(configured, ambientd, out, tmp_path):
    (out / "folder").mkdir()
    (out / "no-socket").write_text("")
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as other:
        other.bind(str(out / "there"))
    long = f"socket:{out}/{'x' * 120}"
    publish = [f"file:{out}/folder", f"socket:{out}/no-socket", long, f"socket:{out}/there", f"file:{out}/good"]
    publish += [f"status:{tmp_path}/later/status"]
    done = ambientd("check", "--config", configured({}, publish=publish), status=1)
    printed = [line for line in done.stdout.splitlines() if line.startswith("output")]
    assert [line.split(": ")[0].split()[1] for line in printed] == [*publish[3:], f"state:{out}/state"]
    faults = done.stderr.splitlines()[1:]
    assert [line.split(": cannot")[0].strip() for line in faults] == [f"output {each}" for each in publish[:3]]
    assert ["folder" in faults[0], "no socket" in faults[1], "107" in faults[2]] == [True] * 3
    assert sorted(os.listdir(out)) == ["folder", "no-socket", "there"]
