"""``ambientd-mqtt`` on a real mosquitto: discovery, the estimate, the last will, and restarts of either side."""

import importlib.util
import json
import shutil
import signal
import socket
import subprocess
import sys
import time

import pytest

AVAILABLE, STATE = "ambientd/phone/availability", "ambientd/phone/state"
CONFIGS = [f"homeassistant/sensor/phone_{name}/config" for name in ("ambient", "status")]


@pytest.fixture
def broker(tmp_path, spawn):
    """Start a mosquitto that forgets everything when it ends, always at the same address."""
    program = shutil.which("mosquitto", path="/usr/sbin:/usr/bin:/usr/local/sbin:/usr/local/bin")
    if program is None or importlib.util.find_spec("paho") is None:
        pytest.skip("mosquitto or paho-mqtt is not installed")
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    (tmp_path / "mosquitto.conf").write_text(f"listener {port} 127.0.0.1\nallow_anonymous true\npersistence false\n")
    return port, lambda: spawn([program, "-c", str(tmp_path / "mosquitto.conf")], stdout=subprocess.DEVNULL)


@pytest.fixture
def retained(broker, until):
    """What a client that connects now is told, by topic."""
    from paho.mqtt import client as mqtt

    def look():
        heard = {}
        client = mqtt.Client(mqtt.CallbackAPIVersion.VERSION2)
        client.on_connect = lambda *_: client.subscribe([("ambientd/#", 1), ("homeassistant/#", 1)])
        client.on_message = lambda client, data, message: heard.__setitem__(message.topic, message.payload.decode())
        try:
            client.connect("127.0.0.1", broker[0])
        except OSError:
            return {}
        end_s = time.monotonic() + 0.3
        while time.monotonic() < end_s:
            client.loop(0.05)
        client.disconnect()
        return heard

    return look


def test_it_follows_the_daemon_over_restarts_of_either_side(
    broker, retained, spawn, until, deployed, model_file, phone
):
    port, start_broker = broker
    path = str(phone.parent / "s")
    run = deployed("run", "--model", model_file, "--sysfs-root", phone, "--rate", "10", "--publish", f"socket:{path}")
    call = [sys.executable, "-m", "ambientd.mqtt", path, "--port", str(port), "--device", "phone", "--stale-after", "2"]

    def ambient():
        return json.loads(retained().get(STATE, "{}")).get("ambient_degC")

    mosquitto = start_broker()
    bridge = spawn(call, stdout=subprocess.DEVNULL, stderr=None)
    until(lambda: {*CONFIGS, AVAILABLE} <= retained().keys(), "nothing is discovered")
    assert retained()[AVAILABLE] == "offline", "there is no daemon yet"
    daemon = spawn(run, env={}, stdout=subprocess.DEVNULL, stderr=None)
    until(lambda: retained().get(AVAILABLE) == "online", "the daemon is not noticed")
    assert ambient() == pytest.approx(23.0)
    config = json.loads(retained()[CONFIGS[0]])
    assert (config["state_topic"], config["device_class"], config["availability"][0]["topic"]) == (
        *(STATE, "temperature", AVAILABLE),
    )
    for kind in ("thermal_zone1", "thermal_zone2"):
        (phone / "class/thermal" / kind / "temp").write_text("31500\n")
    until(lambda: ambient() != pytest.approx(23.0), "it does not follow")

    daemon.send_signal(signal.SIGTERM)
    until(lambda: retained().get(AVAILABLE) == "offline", "a daemon that has ended is not noticed")
    spawn(run, env={}, stdout=subprocess.DEVNULL, stderr=None)
    until(lambda: retained().get(AVAILABLE) == "online", "the next daemon is not noticed")

    mosquitto.kill()
    mosquitto.wait()
    start_broker()
    until(lambda: {*CONFIGS, AVAILABLE, STATE} <= retained().keys(), "the next broker is not told")
    assert retained()[AVAILABLE] == "online"

    bridge.kill()
    until(lambda: retained().get(AVAILABLE) == "offline", "the last will is not heard")
