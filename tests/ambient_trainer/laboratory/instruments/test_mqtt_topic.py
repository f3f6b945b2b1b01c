"""A thermometer on a real broker (mosquitto), to which a client of its own publishes."""

import time

import pytest

from ambient_trainer.laboratory.instruments import settings
from ambient_trainer.laboratory.instruments.mqtt_topic import Driver
from ambient_trainer.laboratory.messages import Clock, Disconnected, InstrumentError, NoResponse
from refusals import refused

TOPIC = "home/desk"


@pytest.fixture
def publish(broker):
    from paho.mqtt import publish

    def send(*messages, retain=False):
        each = [{"topic": TOPIC, "payload": message, "retain": retain, "qos": 1} for message in messages]
        publish.multiple(each, "127.0.0.1", broker.number)

    return send


@pytest.fixture
def driver(broker, closed):
    def make(timeout_s=10.0, **values):
        before = broker.subscriptions(TOPIC)
        named = settings("mqtt-topic", port=broker.address, topic=TOPIC, timeout_s=timeout_s, **values)
        made = closed(Driver(named, Clock()))
        assert made.identify() == f"MQTT topic {TOPIC}"
        broker.until_subscribed(TOPIC, before)
        return made

    return make


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
def test_a_message_is_a_reading_or_shown_in_the_error(publish, driver, values, message, degC):
    thermometer = driver(**values)
    publish("1" if degC is None else message, message)
    time.sleep(0.1)
    if degC is None:
        with pytest.raises(InstrumentError) as caught:
            thermometer.read()
        assert message in caught.value.got
    else:
        assert thermometer.read().values == {"thermometer_degC": pytest.approx(degC)}


def test_a_reading_has_the_time_at_which_its_message_came_and_none_is_repeated_or_retained(publish, driver):
    publish("99", retain=True)
    thermometer = driver(timeout_s=0.5)
    before_s = time.monotonic()
    publish("20", "21")
    time.sleep(0.3)
    thermometer._clock.set(0.0)  # a run begins
    reading = thermometer.read()
    assert before_s - time.monotonic() < reading.asked_s == reading.answered_s < -0.2
    assert reading.values == {"thermometer_degC": 21.0}
    with pytest.raises(NoResponse, match="does it publish"):
        thermometer.read()


def test_a_broker_that_goes_is_an_error_and_is_used_again(broker, publish, driver):
    thermometer = driver(timeout_s=20.0)
    broker.stop()
    with pytest.raises(Disconnected, match=broker.address):
        thermometer.read()
    before = broker.subscriptions(TOPIC)
    broker.start()
    broker.until_subscribed(TOPIC, before)
    publish("22.5")
    assert thermometer.read().values == {"thermometer_degC": 22.5}
    broker.stop()
    with pytest.raises(Disconnected):
        driver()


@pytest.mark.parametrize("values", [{"topic": "home/#"}, {"topic": ""}, {"port": "/dev/ttyUSB0"}, {"unit": "R"}])
def test_settings_that_name_no_single_topic_are_refused(values):
    refused(settings, "mqtt-topic", **{"port": "mqtt://host:1883", "topic": TOPIC, **values})
