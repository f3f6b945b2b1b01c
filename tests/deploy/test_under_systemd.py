"""The unit under a real systemd, with the real sandbox: one that the test boots for itself, beside the machine's."""

import json
import shutil
import urllib.error
import urllib.request
from pathlib import Path

import pytest

from processes import free_port

DEPLOY = Path(__file__).resolve().parents[2] / "deploy"
GUIDE = DEPLOY / "node-exporter" / "README.md"


def configuration():
    """What is shipped, as JSON, with a sensor folder of the test's own and a textfile beside."""
    publish = [
        {"kind": "file", "path": "/run/ambientd/ambient_temp", "poison_millidegC": 60000, "at_exit": "poison"},
        "status:/run/ambientd/status.json",
        "socket:/run/ambientd/ambient.sock",
        "prometheus:/run/ambientd/ambient.prom",
    ]
    state = {"path": "/var/lib/ambientd/state.json", "max_age_s": 30}
    return json.dumps({"model": "model.json", "sysfs_root": "sys", "state": state, "publish": publish})


@pytest.fixture(scope="module")
def machine(tmp_path_factory, zipapp, model_file, boot, at_rest):
    """A machine that has the one file, the unit, a model, a configuration and a fake sysfs at rest at 23 degC."""
    box = tmp_path_factory.mktemp("box")
    etc, local = box / "files/etc/ambientd", box / "files/usr/local/bin"
    at_rest(etc / "sys")
    (etc / "ambientd.json").write_text(configuration())
    shutil.copy(model_file, etc / "model.json")
    local.mkdir(parents=True)
    shutil.copy(zipapp, local / "ambientd")
    units = box / "units"
    (units / "ambientd.service.d").mkdir(parents=True)
    shutil.copy(DEPLOY / "ambientd.service", units)
    # what the guide says of the one file: it reads JSON, and the unit is to name that
    shipped = (DEPLOY / "ambientd.service").read_text()
    commands = [line.replace(".yaml", ".json") for line in shipped.splitlines() if "ambientd.yaml" in line]
    assert [line.partition("=")[0] for line in commands] == ["ExecStart", "ExecStopPost"]
    ours = ["[Service]", "ExecStart=", "ExecStopPost=", *commands, "RestartSec=0.1", "StandardError=append:/box/stderr"]
    (units / "ambientd.service.d" / "json.conf").write_text("\n".join(ours) + "\n")
    shutil.copytree(DEPLOY / "sysusers.d", box / "files/usr/lib/sysusers.d")
    (box / "files/etc/default").mkdir()
    with boot(box) as running:
        running.run("systemd-sysusers", "ambientd.conf")
        yield running


@pytest.fixture
def started(machine):
    """The unit, started: that comes back when the first estimate is out."""
    machine.run("systemctl", "start", "ambientd")
    yield machine
    machine.run("systemctl", "stop", "ambientd")
    machine.run("systemctl", "reset-failed", "ambientd", check=False)


def test_the_unit_publishes_to_all_and_stops_clean(started, listen):
    assert started.file("/run/ambientd/ambient_temp").read_text() == "23000\n"
    assert json.loads(started.file("/run/ambientd/status.json").read_text())["ambient_degC"] == 23.0
    assert started.show("StatusText") == "model 'phone': warming_up"
    owners = started.run("stat", "-c", "%U %a", "/run/ambientd", "/run/ambientd/ambient_temp").splitlines()
    assert owners == ["ambientd 755", "ambientd 644"]
    # any user inside reads the file, and follows the socket
    nobody = ["setpriv", "--reuid=65534", "--regid=65534", "--clear-groups"]
    assert started.run(*nobody, "cat", "/run/ambientd/ambient_temp") == "23000\n"
    assert started.run(*nobody, "stat", "-c", "%a", "/run/ambientd/ambient.sock") == "666\n"
    assert json.loads(listen(started.file("/run/ambientd/ambient.sock")).readline())["ambient_degC"] == 23.0
    started.run("systemctl", "stop", "ambientd")
    assert (started.show("Result"), started.show("ExecMainStatus")) == ("success", "0")
    left = started.run("ls", "/run/ambientd").split()
    assert (left, started.file("/run/ambientd/ambient_temp").read_text()) == (["ambient_temp"], "60000\n")
    assert started.file("/var/lib/ambientd/state.json").exists()


def test_a_restart_goes_on_and_a_reload_with_a_bad_model_changes_nothing(started, until):
    started.run("systemctl", "restart", "ambientd")
    assert "state /var/lib/ambientd/state.json: continuing from" in (started.box / "stderr").read_text()
    process = started.show("MainPID")
    model = started.file("/etc/ambientd/model.json")
    good = model.read_text()
    try:
        model.write_text("{}")
        started.run("systemctl", "reload", "ambientd")
        until(lambda: "not reloaded" in (started.box / "stderr").read_text())
    finally:
        model.write_text(good)
    assert (started.show("MainPID"), started.show("ActiveState")) == (process, "active")


@pytest.fixture
def drop_in(request, machine):
    """One more setting of the unit, for a test."""
    path = machine.file("/run/systemd/system/ambientd.service.d/test.conf")
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f"[Service]\n{request.param}\n")
    machine.run("systemctl", "daemon-reload")
    yield
    path.unlink()
    machine.run("systemctl", "daemon-reload")


@pytest.mark.parametrize("drop_in", ["WatchdogSec=2"], indirect=True)
def test_a_daemon_that_hangs_is_killed_and_started_again(drop_in, started, until):
    process = started.show("MainPID")
    started.run("kill", "-STOP", process)
    until(lambda: started.show("MainPID") not in (process, "0") and started.show("ActiveState") == "active")
    assert started.show("NRestarts") == "1"
    assert started.file("/run/ambientd/ambient_temp").read_text() == "23000\n"


@pytest.mark.parametrize("drop_in", ["Restart=no"], indirect=True)
def test_a_killed_daemon_leaves_nothing_that_could_be_taken_for_a_value(drop_in, started, until):
    """Not even while it is not started again."""
    started.run("kill", "-KILL", started.show("MainPID"))
    until(lambda: started.show("ActiveState") == "failed")
    left = started.run("ls", "/run/ambientd").split()
    assert (left, started.file("/run/ambientd/ambient_temp").read_text()) == (["ambient_temp"], "60000\n")


def test_node_exporter_as_debian_starts_it_serves_the_estimate(started, until):
    """After the one command of the guide; Debian's folder of text files lies in one of another user."""
    if not started.file("/usr/bin/prometheus-node-exporter").exists():
        pytest.skip("prometheus-node-exporter is not installed")
    address = f"127.0.0.1:{free_port()}"
    started.file("/etc/default/prometheus-node-exporter").write_text(f'ARGS="--web.listen-address={address}"\n')
    [command] = [line for line in GUIDE.read_text().splitlines() if line.startswith("ln -s ")]
    started.run("sh", "-ec", command)
    started.run("systemctl", "start", "prometheus-node-exporter")
    fetch = urllib.request.build_opener(urllib.request.ProxyHandler({})).open

    def metrics():
        try:
            with fetch(f"http://{address}/metrics", timeout=10) as answer:
                return answer.read().decode()
        except urllib.error.URLError:
            return ""

    try:
        until(metrics)
        page = metrics()
        assert 'ambientd_ambient_celsius{model="phone"} 23\n' in page
        assert "# TYPE ambientd_ambient_celsius gauge" in page
        assert 'ambientd_sensor_raw{sensor="usb",unit="degC"} 24.5' in page
        assert "node_textfile_scrape_error 0" in page
        started.run("systemctl", "stop", "ambientd")
        assert "node_textfile_scrape_error 1" in metrics()
    finally:
        started.run("systemctl", "stop", "prometheus-node-exporter")
