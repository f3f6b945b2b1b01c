"""Ports come and go, are in use, are none, and say stop; the next question opens them again."""

from __future__ import annotations

import os
import threading

import pytest

from ambient_trainer.laboratory.instruments.chamber import Chamber
from ambient_trainer.laboratory.instruments.multiplexer import Multiplexer
from ambient_trainer.laboratory.instruments.thermometer import Thermometer
from ambient_trainer.laboratory.line import Silent, Unplugged
from ambient_trainer.laboratory.simulated.terminal import XOFF

KINDS = {"chamber": Chamber, "multiplexer": Multiplexer, "thermometer": Thermometer}
each_kind = pytest.mark.parametrize("kind", KINDS)


@each_kind
def test_a_cable_that_is_pulled_and_put_in_again(bench, kind) -> None:
    bench = bench(kind)
    bench.driver.read()
    bench.simulated.unplug()
    error = bench.failure(Unplugged)
    assert error.expected == "the port to stay"
    for _ in range(2):
        error = bench.failure(Unplugged)
        assert (error.expected, error.got) == ("a port that can be opened", "No such file or directory")
    bench.simulated.plug()
    assert bench.reading() == pytest.approx(21.5, abs=0.1)


def test_a_port_that_went_is_let_go(bench) -> None:
    bench = bench("thermometer")
    held = []
    for _ in range(5):
        bench.driver.read()
        bench.simulated.unplug()
        held.append(bench.failure(Unplugged))  # with the frames that the port was used in
        bench.simulated.plug()
        held.append(len(os.listdir("/proc/self/fd")))
    assert held[-1] == held[1]


@each_kind
def test_a_cable_that_is_pulled_in_the_middle_of_an_answer(bench, kind) -> None:
    bench = bench(kind)
    bench.driver.read()
    bench.simulated.twist(lambda reply: [(0.0, reply[:3]), (1000.0, reply[3:])])
    puller = threading.Timer(0.1, bench.simulated.unplug)
    puller.start()
    bench.failure(Unplugged)
    puller.join()
    bench.simulated.plug()
    assert bench.reading() == pytest.approx(21.5, abs=0.1)


@each_kind
def test_a_port_that_is_in_use(bench, kind) -> None:
    bench = bench(kind)
    bench.driver.read()
    probes = ({"air": 103},) if kind == "multiplexer" else ()
    second = KINDS[kind](bench.simulated.port, *probes, clock=bench.clock, name="second")
    with pytest.raises(Unplugged, match=r"second on .*: expected a port that can be opened, got one that is in use; "):
        second.read()
    bench.driver.close()
    assert second.read()
    second.close()


@each_kind
def test_a_port_that_is_no_port(kind, tmp_path) -> None:
    path = tmp_path / "a file"
    path.write_text("")
    driver = KINDS[kind](str(path), *(({"air": 103},) if kind == "multiplexer" else ()))
    with pytest.raises(Unplugged) as caught:
        driver.read()
    assert caught.value.port == str(path)


def test_a_hand_that_is_held_up_does_not_hold_up_for_ever(bench) -> None:
    bench = bench("multiplexer")
    bench.driver.read()
    bench.simulated.say(XOFF)
    bench.clock.sleep(2.0)
    error = bench.failure(Silent)
    assert error.got == "its hand held up (XOFF) all the time"
    assert bench.reading() == pytest.approx(21.5, abs=0.1)
