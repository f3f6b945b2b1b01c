"""A thermometer that publishes to an MQTT broker: a message is a reading, at the time at which it came.

A message holds a number, or JSON with the number under ``key``, as zigbee2mqtt and Tasmota publish it. One that the
broker retained is as old as nobody knows, and is left out.
"""

import contextlib
import json
import math
import queue
import socket
from collections.abc import Callable
from functools import reduce
from pathlib import Path
from typing import Annotated, Any, Literal
from urllib.parse import urlsplit

from pydantic import Field, PositiveFloat

from ambient_trainer.data.units import to_base
from ambient_trainer.laboratory.instruments import DIGITS, THERMOMETER_COLUMN, Air, ThermometerSettings
from ambient_trainer.laboratory.messages import Clock, Disconnected, InstrumentError, NoResponse, Reading, in_background

_PORTS = {"mqtt": 1883, "mqtts": 8883}
_NETWORK = "is it the broker's address, does it run, and does it take this user and password?"
_PUBLISHER = "does it publish to this topic, and as often as 'timeout_s' says? (mosquitto_sub -v -t '#')"


class Settings(ThermometerSettings):
    """The topic at the broker ``port``, ``mqtt://HOST:1883`` or with TLS ``mqtts://HOST:8883``.

    ``key`` leads to the number in JSON, as ``DS18B20.Temperature``. ``timeout_s`` is the longest time between two
    messages, of which each is a sample. ``password_file`` has the password of ``user`` in its first line.
    """

    kind: Literal["mqtt-topic"]
    port: Annotated[str, Field(pattern=r"^mqtts?://[^/:]+(:\d+)?$")]
    topic: Annotated[str, Field(pattern=r"^[^#+]{1,80}$")]
    key: str = ""
    unit: Literal["degC", "degF", "K"] = "degC"
    period_s: PositiveFloat = 1.0
    timeout_s: PositiveFloat = 120.0
    user: str | None = None
    password_file: str | None = None


class Driver:
    """A subscriber of the topic."""

    def __init__(self, settings: Settings, clock: Clock) -> None:
        # a run sets its clock when it begins, while messages come
        self._settings, self._clock, self._never_set = settings, clock, Clock()
        self._came: queue.SimpleQueue[tuple[float, bytes] | str] = queue.SimpleQueue()
        self._client: Any = None

    def identify(self) -> str:
        self._connect()
        return f"MQTT topic {self._settings.topic}"

    def read(self) -> Reading:
        """The newest message that came since the last one was read, or the next."""
        self._connect()
        newest: tuple[float, bytes] | str | None = None
        with contextlib.suppress(queue.Empty):
            newest = self._came.get(timeout=self._clock.patience_s(self._settings.timeout_s))
            while True:
                newest = self._came.get_nowait()
        if newest is None:
            raise self._failed(f"nothing in {self._settings.timeout_s:g} s", NoResponse, _PUBLISHER)
        if isinstance(newest, str):
            raise self._failed(newest, Disconnected, _NETWORK)
        (came_s, message), key = newest, self._settings.key
        try:
            value = float(reduce(lambda inner, name: inner[name], key.split(".") if key else (), json.loads(message)))
            if not math.isfinite(value):
                raise ValueError("not finite")
        except (ValueError, TypeError, LookupError) as error:
            hint = "is 'key' the way to the number in it?"
            raise self._failed(repr(message[:80].decode("utf-8", "replace")), InstrumentError, hint) from error
        at_s = self._clock.now_s() - self._clock.speed * (self._never_set.now_s() - came_s)
        return Reading(at_s, at_s, {THERMOMETER_COLUMN: round(to_base(value, self._settings.unit), DIGITS)})

    def close(self) -> None:
        client, self._client = self._client, None
        if client is not None:
            client.disconnect()
            client.loop_stop()

    def _failed(self, got: str, kind: type[InstrumentError], hint: str) -> InstrumentError:
        return kind("thermometer", self._settings.port, f"a number from topic {self._settings.topic}", got, hint)

    def _connect(self) -> None:
        if self._client is not None:
            return
        try:
            from paho.mqtt import client as mqtt
        except ImportError as error:
            raise self._failed("no paho-mqtt here", Disconnected, "install ambientd[mqtt]") from error
        address, client = urlsplit(self._settings.port), mqtt.Client(mqtt.CallbackAPIVersion.VERSION2)
        client.on_connect, client.on_message = self._connected, self._received
        client.on_disconnect = lambda *parts: self._came.put(f"the end of the connection ({parts[3]})")
        try:
            if address.scheme == "mqtts":
                client.tls_set()
            if self._settings.user is not None:
                path = self._settings.password_file
                password = Path(path).read_text("utf-8").partition("\n")[0] if path else None
                client.username_pw_set(self._settings.user, password)
            client.connect(address.hostname or "", address.port or _PORTS[address.scheme])
        except OSError as error:
            raise self._failed(error.strerror or str(error), Disconnected, _NETWORK) from error
        client.loop_start()
        self._client = client

    def _connected(self, client: Any, data: object, flags: object, reason: Any, properties: object) -> None:
        if reason.is_failure:
            self._came.put(f"a refusal: {reason}")
        client.subscribe(self._settings.topic)

    def _received(self, client: object, data: object, message: Any) -> None:
        if not message.retain:
            self._came.put((self._never_set.now_s(), message.payload))


_PUBLISHES_S = 5.0
_LEAST_WALL_S = 0.02
_ANSWERS: dict[int, Callable[[bytes], bytes]] = {
    0x10: lambda connect: b"\x20\x02\x00\x00",
    0x82: lambda subscribe: b"\x90\x03" + subscribe[2:4] + b"\x00",
    0xC0: lambda ping: b"\xd0\x00",
}
"""By the first byte of a subscriber's packet what a broker answers (MQTT 3.1.1, sections 3.1 to 3.12)."""


class Simulated:
    """The thermometer in ``air``, and a broker that serves one subscriber."""

    def __init__(self, settings: Settings, clock: Clock, air: Air) -> None:
        self._settings, self._clock, self._air = settings, clock, air
        self._server, self._ended = socket.create_server(("127.0.0.1", 0)), False
        self._server.settimeout(0.2)
        self.port = f"mqtt://127.0.0.1:{self._server.getsockname()[1]}"
        self._thread = in_background(self._run)

    def close(self) -> None:
        self._ended = True
        self._thread.result()
        self._server.close()

    def _run(self) -> None:
        while not self._ended:
            with contextlib.suppress(OSError), self._server.accept()[0] as connection:
                self._serve(connection)

    def _serve(self, connection: socket.socket) -> None:
        due_s, subscribed = 0.0, False
        while not self._ended:
            now_s = self._clock.now_s()
            if subscribed and now_s >= due_s:
                due_s = now_s + _PUBLISHES_S
                connection.sendall(self._message(now_s))
            connection.settimeout(max(self._clock.wall_s(due_s - now_s), _LEAST_WALL_S))
            with contextlib.suppress(TimeoutError):
                if not (packet := connection.recv(1024)):
                    return
                connection.sendall(_ANSWERS.get(packet[0], lambda other: b"")(packet))
                subscribed = subscribed or packet[0] == 0x82

    def _message(self, at_s: float) -> bytes:
        zero_degC, one_degC = (to_base(value, self._settings.unit) for value in (0.0, 1.0))
        content: Any = round((self._air(at_s) - zero_degC) / (one_degC - zero_degC), 2)
        for name in reversed(self._settings.key.split(".") if self._settings.key else ()):
            content = {name: content}
        topic = self._settings.topic.encode()
        body = len(topic).to_bytes(2, "big") + topic + json.dumps(content).encode()
        return b"\x30" + bytes((len(body),)) + body
