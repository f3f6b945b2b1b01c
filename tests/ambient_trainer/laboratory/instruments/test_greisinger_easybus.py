import pytest

from ambient_trainer.laboratory.instruments import settings
from ambient_trainer.laboratory.instruments.greisinger_easybus import VALUE, Simulated, body_of_number, reply
from ambient_trainer.laboratory.messages import Clock, InstrumentError, NoResponse
from breaking import distort


def test_without_a_sensor_it_reports_that_instead_of_a_number(bench):
    bench = bench("thermometer")
    bench.driver.read()
    distort(
        bench.simulated, lambda value: reply(1, VALUE, body_of_number(17 << 27 | (0x07F5E100 + 16365)), faulty=True)
    )
    reading = bench.driver.read()
    assert (*reading.values.values(), reading.note) == (None, "no sensor")
    assert bench.reading() == 21.5


def test_one_of_another_address_is_not_taken_for_it(driver_at, closed):
    clock = Clock(20.0)
    simulated = closed(Simulated(settings("greisinger-easybus", port="", address=2), clock, lambda at_s: 20.0))
    first, second = (driver_at("thermometer", simulated.port, clock, address=address) for address in (1, 2))
    with pytest.raises(NoResponse):
        first.read()
    first.close()
    assert second.read().values == {"thermometer_degC": 20.0}
    distort(simulated, lambda reply: bytes.fromhex("FE 05 26 71 00 48 F7 80 09"))
    with pytest.raises(InstrumentError) as caught:
        second.read()
    assert ("address 2" in caught.value.expected, "address 1" in caught.value.got) == (True, True)


def test_an_impossible_value_is_an_error(bench):
    bench = bench("thermometer")
    bench.driver.read()
    distort(bench.simulated, lambda reply: bytes.fromhex("FE 05 26 FE 05 26 71 00 48"))
    assert "-15 decimals" in bench.failure().got
