"""``ambientd-mqtt`` on a real mosquitto: discovery, the estimate, the last will, and restarts of either side."""

import itertools
import json
import signal
import subprocess
import sys
import time

import pytest

AVAILABLE, STATE = "ambientd/phone.lan/availability", "ambientd/phone.lan/state"
CONFIGS = [f"homeassistant/sensor/phone_lan_{name}/config" for name in ("ambient", "status")]


def told(broker):
    """What a client that connects now is told, by topic."""
    from paho.mqtt import client as mqtt

    heard = {}
    client = mqtt.Client(mqtt.CallbackAPIVersion.VERSION2)
    client.on_connect = lambda *_: client.subscribe([("ambientd/#", 1), ("homeassistant/#", 1)])
    client.on_message = lambda client, data, message: heard.__setitem__(message.topic, message.payload.decode())
    try:
        client.connect("127.0.0.1", broker.number)
    except OSError:
        return {}
    end_s = time.monotonic() + 0.3
    while time.monotonic() < end_s:
        client.loop(0.05)
    client.disconnect()
    return heard


@pytest.fixture
def states(broker):
    """The content of each state that is published from when it is called on."""
    from paho.mqtt import client as mqtt

    client = mqtt.Client(mqtt.CallbackAPIVersion.VERSION2)

    def listen():
        heard = []
        client.on_message = lambda client, data, message: heard.append(json.loads(message.payload))
        client.connect("127.0.0.1", broker.number)
        client.subscribe(STATE)
        client.loop_start()
        return heard

    yield listen
    client.loop_stop()
    client.disconnect()


def test_it_follows_the_daemon_over_restarts_of_either_side(
    broker, states, spawn, until, listen, deployed, model_file, phone
):
    path = str(phone.parent / "s")
    run = deployed("run", "--model", model_file, "--sysfs-root", phone, "--rate", "10", "--publish", f"socket:{path}")
    call = [sys.executable, "-m", "ambientd.mqtt", path, "--device", "phone.lan", "--stale-after", "2"]
    call += ["--port", str(broker.number)]

    def ambient():
        return json.loads(told(broker).get(STATE, "{}")).get("ambient_degC")

    bridge = spawn(call, stdout=subprocess.DEVNULL, stderr=None)
    until(lambda: {*CONFIGS, AVAILABLE} <= told(broker).keys(), "nothing is discovered")
    assert told(broker)[AVAILABLE] == "offline", "there is no daemon yet"
    daemon = spawn(run, env={}, stdout=subprocess.DEVNULL, stderr=None)
    until(lambda: told(broker).get(AVAILABLE) == "online", "the daemon is not noticed")
    assert ambient() == pytest.approx(23.0)
    config = json.loads(told(broker)[CONFIGS[0]])
    assert (config["state_topic"], config["device_class"], config["availability"][0]["topic"]) == (
        *(STATE, "temperature", AVAILABLE),
    )
    heard = states()
    until(lambda: heard, "the state is not retained")
    ticks = map(json.loads, listen(path))
    for kind in ("thermal_zone1", "thermal_zone2"):
        (phone / "class/thermal" / kind / "temp").write_text("31500\n")
    changed = next(each for each in ticks if each["ambient_degC"] != pytest.approx(23.0))
    until(lambda: heard[-1]["ambient_degC"] != pytest.approx(23.0), "it does not follow")
    # on the clock of the ticks: which of them the broker has
    first = next(each for each in heard if each["ambient_degC"] != pytest.approx(23.0))
    following = [changed, *itertools.islice(ticks, 19)]
    assert first["ambient_degC"] in [each["ambient_degC"] for each in following], "it follows more than 2 s later"
    daemon.send_signal(signal.SIGTERM)
    until(lambda: told(broker).get(AVAILABLE) == "offline", "a daemon that has ended is not noticed")
    spawn(run, env={}, stdout=subprocess.DEVNULL, stderr=None)
    until(lambda: told(broker).get(AVAILABLE) == "online", "the next daemon is not noticed")
    broker.stop()
    broker.start()
    until(lambda: {*CONFIGS, AVAILABLE, STATE} <= told(broker).keys(), "the next broker is not told")
    assert told(broker)[AVAILABLE] == "online"
    bridge.kill()
    until(lambda: told(broker).get(AVAILABLE) == "offline", "the last will is not heard")
