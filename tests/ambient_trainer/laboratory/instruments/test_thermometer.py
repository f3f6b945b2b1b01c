from __future__ import annotations

import pytest

from ambient_trainer.laboratory.clock import FastClock
from ambient_trainer.laboratory.instruments.thermometer import Thermometer
from ambient_trainer.laboratory.line import LineError, SwitchedOff
from ambient_trainer.laboratory.simulated.thermometer import SimulatedThermometer


def test_it_reads_and_says_its_number(bench) -> None:
    bench = bench("thermometer")
    assert bench.driver.identify() == "GMH thermometer, number 32407008"
    bench.air_degC[0] = -0.04
    reading = bench.driver.read()
    assert (reading.temp_degC, reading.reason) == (-0.04, None)


def test_without_a_sensor_it_says_so_instead_of_a_number(bench) -> None:
    bench = bench("thermometer")
    bench.simulated.pull_sensor()
    reading = bench.driver.read()
    assert (reading.temp_degC, reading.reason) == (None, "no sensor")
    bench.simulated.push_sensor()
    assert bench.driver.read().temp_degC == 21.5


def test_it_switches_itself_off_and_is_switched_on_again(tmp_path) -> None:
    clock = FastClock(500.0)
    simulated = SimulatedThermometer(clock, lambda at_s: 20.0, folder=str(tmp_path), auto_off_s=1200.0)
    thermometer = Thermometer(simulated.port, clock=clock)
    assert thermometer.read().temp_degC == 20.0
    clock.sleep(1200.0)
    for _ in range(2):
        with pytest.raises(SwitchedOff, match=r"; switch it on$"):
            thermometer.read()
    simulated.switch_on()
    assert thermometer.read().temp_degC == 20.0
    thermometer.close()
    simulated.close()


def test_one_of_another_address_is_not_taken_for_it(tmp_path) -> None:
    clock = FastClock(20.0)
    simulated = SimulatedThermometer(clock, lambda at_s: 20.0, folder=str(tmp_path), address=2)
    first, second = (Thermometer(simulated.port, clock=clock, address=address) for address in (1, 2))
    with pytest.raises(SwitchedOff):
        first.read()
    first.close()
    assert second.read().temp_degC == 20.0
    simulated.twist(lambda reply: [(0.0, bytes.fromhex("FE 05 26 71 00 48 F7 80 09"))])
    with pytest.raises(LineError, match=r"expected its value, a reply of address 2 to code 0, got .* address 1"):
        second.read()
    second.close()
    simulated.close()


def test_an_impossible_value_is_an_error(bench) -> None:
    bench = bench("thermometer")
    bench.driver.read()
    bench.simulated.twist(lambda reply: [(0.0, bytes.fromhex("FE 05 26 FE 05 26 71 00 48"))])
    with pytest.raises(LineError, match="expected a value of 0 to 7 decimals, got -15 decimals"):
        bench.driver.read()
