"""A thermometer on a real broker (mosquitto), to which a client of its own publishes."""

import importlib.util
import shutil
import socket
import subprocess
import time

import pytest

from ambient_model.faults import Refused
from ambient_trainer.laboratory.instruments import settings
from ambient_trainer.laboratory.instruments.mqtt_topic import Driver
from ambient_trainer.laboratory.messages import Clock, Disconnected, InstrumentError, NoResponse

MOSQUITTO = shutil.which("mosquitto", path="/usr/sbin:/usr/bin:/usr/local/sbin:/usr/local/bin")
needs_broker = pytest.mark.skipif(
    MOSQUITTO is None or importlib.util.find_spec("paho") is None, reason="mosquitto or paho-mqtt is not installed"
)
TOPIC = "home/desk"


class Broker:
    """A broker that can be stopped and started at the same address, and what publishes to it."""

    def __init__(self, folder, until):
        with socket.create_server(("127.0.0.1", 0)) as free:
            self.number = free.getsockname()[1]
        self.port, self.file = f"mqtt://127.0.0.1:{self.number}", folder / "mosquitto.conf"
        self.log = folder / "mosquitto.log"
        keys = (f"listener {self.number} 127.0.0.1", "allow_anonymous true", "persistence false", "user root")
        self.file.write_text("\n".join((*keys, f"log_dest file {self.log}", "log_type subscribe\n")))
        self.until = until
        self.start()

    def start(self):
        self.process = subprocess.Popen([MOSQUITTO, "-c", str(self.file)], stderr=subprocess.DEVNULL)
        self.until(self._answers)

    def _answers(self):
        with socket.socket() as asked:
            return not asked.connect_ex(("127.0.0.1", self.number))

    def subscriptions(self):
        return self.log.read_text().count(f" {TOPIC}") if self.log.exists() else 0

    def until_subscribed(self, before):
        """What is published earlier, nobody hears."""
        self.until(lambda: self.subscriptions() != before)

    def stop(self):
        self.process.kill()
        self.process.wait()

    def publish(self, *messages, retain=False):
        from paho.mqtt import publish

        each = [{"topic": TOPIC, "payload": message, "retain": retain, "qos": 1} for message in messages]
        publish.multiple(each, "127.0.0.1", self.number)


@pytest.fixture
def broker(tmp_path, until):
    made = Broker(tmp_path, until)
    yield made
    made.stop()


@pytest.fixture
def driver(broker, closed):
    def make(timeout_s=10.0, **values):
        before = broker.subscriptions()
        named = settings("mqtt-topic", port=broker.port, topic=TOPIC, timeout_s=timeout_s, **values)
        made = closed(Driver(named, Clock()))
        assert made.identify() == f"MQTT topic {TOPIC}"
        broker.until_subscribed(before)
        return made

    return make


@needs_broker
@pytest.mark.parametrize(
    ("values", "message", "degC"),
    [
        ({}, "21.55", 21.55),
        ({"unit": "degF"}, "50", 10.0),
        ({"key": "temperature"}, '{"battery": 90, "temperature": 19.25}', 19.25),
        ({"key": "BME280.T", "unit": "K"}, '{"BME280": {"T": "273.15"}}', 0.0),
        ({}, '{"temperature": 19}', None),
        ({"key": "t"}, "19", None),
        ({"key": "t.u"}, '{"t": {}}', None),
        ({}, "unavailable", None),
        ({}, "NaN", None),
    ],
)
def test_a_message_is_a_reading_or_shown_in_the_error(broker, driver, values, message, degC):
    thermometer = driver(**values)
    broker.publish("1" if degC is None else message, message)
    time.sleep(0.1)
    if degC is None:
        with pytest.raises(InstrumentError) as caught:
            thermometer.read()
        assert message in caught.value.got
    else:
        assert thermometer.read().values == {"thermometer_degC": pytest.approx(degC)}


@needs_broker
def test_a_reading_has_the_time_at_which_its_message_came_and_none_is_repeated_or_retained(broker, driver):
    broker.publish("99", retain=True)
    thermometer = driver(timeout_s=0.5)
    before_s = thermometer._clock.now_s()
    broker.publish("20", "21")
    time.sleep(0.3)
    reading = thermometer.read()
    assert before_s < reading.asked_s == reading.answered_s < thermometer._clock.now_s() - 0.2
    assert reading.values == {"thermometer_degC": 21.0}
    with pytest.raises(NoResponse, match="does it publish"):
        thermometer.read()


@needs_broker
def test_a_broker_that_goes_is_an_error_and_is_used_again(broker, driver):
    thermometer = driver(timeout_s=20.0)
    broker.stop()
    with pytest.raises(Disconnected, match=broker.port):
        thermometer.read()
    before = broker.subscriptions()
    broker.start()
    broker.until_subscribed(before)
    broker.publish("22.5")
    assert thermometer.read().values == {"thermometer_degC": 22.5}
    broker.stop()
    with pytest.raises(Disconnected):
        driver()


@pytest.mark.parametrize("values", [{"topic": "home/#"}, {"topic": ""}, {"port": "/dev/ttyUSB0"}, {"unit": "R"}])
def test_settings_that_name_no_single_topic_are_refused(values):
    with pytest.raises(Refused):
        settings("mqtt-topic", **{"port": "mqtt://host:1883", "topic": TOPIC, **values})
