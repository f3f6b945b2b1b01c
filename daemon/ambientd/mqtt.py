"""``ambientd-mqtt``: takes the socket's lines to an MQTT broker, in a process of its own; needs ``ambientd[mqtt]``.

Everything is retained and published anew with each connection, so that a restart of either side loses nothing:

- ``TOPIC/DEVICE/state``: the newest reading as JSON, at most one a second;
- ``TOPIC/DEVICE/availability``: ``online`` while readings come; ``offline`` otherwise, also as the last will;
- ``DISCOVERY/sensor/DEVICE_*/config``: what Home Assistant makes its entities of.
"""

import argparse
import importlib
import json
import os
import re
import sys
from typing import Any

from ambient_model import __version__
from ambientd.client import Follower, Reading, clock_s
from ambientd.notices import log

_LOOK_S = 0.5
_LEAST_S = 1.0
"""Between two states."""
_DELAYS_S = (1, 30)


def main() -> int:
    """Run the command line; returns its exit status."""
    options = _parser().parse_args()
    try:
        client = importlib.import_module("paho.mqtt.client")
    except ImportError:
        log("paho-mqtt is not installed; install 'ambientd[mqtt]'")
        return 1
    try:
        _Bridge(client, options).run()
    except KeyboardInterrupt:
        return 0
    except OSError as error:
        log(f"{error.filename or options.host}: {error.strerror or error}")
        return 1
    except ValueError as error:
        log(f"--host {options.host!r}: {error}")
        return 1
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="ambientd-mqtt", description="Take ambientd's estimate to an MQTT broker.")
    parser.add_argument("socket", metavar="SOCKET", help="that ambientd publishes with socket:SOCKET")
    parser.add_argument("--host", default="localhost")
    parser.add_argument("--port", type=_port, default=1883)
    parser.add_argument("--tls", action="store_true", help="with the system's certificates")
    parser.add_argument("--user")
    parser.add_argument("--password-file", metavar="FILE", help="its first line is the password")
    parser.add_argument("--topic", type=_topic, default="ambientd")
    parser.add_argument(
        "--device", type=_topic, default=os.uname().nodename, help="its name in topics (default: the host's)"
    )
    parser.add_argument("--discovery", default="homeassistant", help="Home Assistant's prefix; empty for none")
    parser.add_argument(
        "--stale-after", metavar="S", type=float, default=15.0, help="offline without a reading for S s"
    )
    return parser


def _port(text: str) -> int:
    if not 0 < int(text) < 65536:
        raise argparse.ArgumentTypeError(f"{text}: ports are 1 to 65535")
    return int(text)


def _topic(text: str) -> str:
    if not text or not text.isprintable() or "+" in text or "#" in text:
        raise argparse.ArgumentTypeError(f"{text!r} is part of topics: leave out +, # and control characters")
    return text


def discovery(topic: str, device: str, prefix: str) -> dict[str, dict[str, Any]]:
    """Home Assistant's configuration of each entity, by its topic."""
    about = {
        "identifiers": [f"ambientd_{device}"],
        "name": device,
        "manufacturer": "ambientd",
        "sw_version": __version__,
    }
    # it passes over a topic with anything else, as a host's full name
    object_id = re.sub("[^a-zA-Z0-9_-]", "_", device)
    there = {"topic": f"{topic}/availability"}
    known = {"topic": f"{topic}/state", "value_template": _KNOWN}
    celsius: dict[str, Any] = {"unit_of_measurement": "°C", "device_class": "temperature", "state_class": "measurement"}
    entities = {
        "ambient": ("ambient_degC", [there, known], {**celsius, "suggested_display_precision": 1}),
        "status": ("status", [there], {"entity_category": "diagnostic", "icon": "mdi:heart-pulse"}),
    }
    return {
        f"{prefix}/sensor/{object_id}_{name}/config": {
            "name": name.capitalize(),
            "unique_id": f"ambientd_{device}_{name}",
            "state_topic": f"{topic}/state",
            "value_template": f"{{{{ value_json.{key} }}}}",
            "availability": availability,
            "availability_mode": "all",
            "device": about,
            **more,
        }
        for name, (key, availability, more) in entities.items()
    }


_KNOWN = "{{ 'online' if value_json.ambient_degC is not none else 'offline' }}"


def state(reading: Reading) -> dict[str, Any]:
    """What is published of a reading; a value that is not known is null."""
    keys = ("status", "ambient_degC", "low_degC", "high_degC", "level_percent", "age_s", "model")
    return {key: getattr(reading, key) for key in keys}


class _Bridge:
    """A follower of the socket and a client of the broker."""

    def __init__(self, mqtt: Any, options: argparse.Namespace) -> None:
        self._options = options
        self._topic = f"{options.topic}/{options.device}"
        self._retained: dict[str, str] = {self._available: "offline"}
        if options.discovery:
            configurations = discovery(self._topic, options.device, options.discovery)
            self._retained.update({topic: json.dumps(each) for topic, each in configurations.items()})
        self._client = mqtt.Client(mqtt.CallbackAPIVersion.VERSION2, client_id=f"ambientd-{options.device}")
        self._client.on_connect = self._connected
        self._client.on_disconnect = self._disconnected
        self._client.reconnect_delay_set(*_DELAYS_S)
        self._client.will_set(self._available, "offline", qos=1, retain=True)
        if options.user is not None:
            self._client.username_pw_set(options.user, _password(options.password_file))
        if options.tls:
            self._client.tls_set()

    @property
    def _available(self) -> str:
        return f"{self._topic}/availability"

    def _connected(self, client: Any, data: Any, flags: Any, reason: Any, properties: Any) -> None:
        log(f"{self._options.host}: {'refused (' + str(reason) + ')' if reason.is_failure else 'connected'}")
        for topic, content in list(self._retained.items()):
            client.publish(topic, content, qos=1, retain=True)

    def _disconnected(self, client: Any, data: Any, flags: Any, reason: Any, properties: Any) -> None:
        log(f"{self._options.host}: disconnected ({reason})")

    def _publish(self, topic: str, content: str) -> None:
        self._retained[topic] = content
        if self._client.is_connected():  # otherwise it is published with the connection
            self._client.publish(topic, content, qos=1, retain=True)

    def run(self) -> None:
        """Follow until it is interrupted."""
        self._client.connect_async(self._options.host, self._options.port, keepalive=10)
        self._client.loop_start()
        published_s = -_LEAST_S
        with Follower(self._options.socket, self._options.stale_after) as follower:
            while True:
                reading = follower.wait(_LOOK_S)
                now_s = clock_s()
                if reading is not None and now_s - published_s >= _LEAST_S:
                    published_s = now_s
                    self._publish(f"{self._topic}/state", json.dumps(state(reading)))
                fresh = follower.age_s <= self._options.stale_after and not follower.problem
                available = "online" if fresh else "offline"
                if self._retained[self._available] != available:
                    self._publish(self._available, available)


def _password(path: str | None) -> str | None:
    if path is None:
        return None
    with open(path, encoding="utf-8") as stream:
        return stream.readline().rstrip("\n")


if __name__ == "__main__":
    sys.exit(main())
