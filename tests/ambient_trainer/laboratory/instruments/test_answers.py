"""What comes instead of an answer is an error that names instrument, port and what was expected; never a reading."""

from __future__ import annotations

import threading
import time

import pytest

from ambient_trainer.laboratory.clock import FastClock
from ambient_trainer.laboratory.instruments.chamber import Chamber
from ambient_trainer.laboratory.instruments.multiplexer import Multiplexer
from ambient_trainer.laboratory.instruments.thermometer import Thermometer
from ambient_trainer.laboratory.line import LineError, Silent, SwitchedOff

STATE = b"0010.0 0011.2 0000.0 0011.2 0000.0 0011.2 0000.0 0011.2 0000.0 0011.2 0101010101010100\r"
SCAN = b"+2.61950000E+01,101,+2.61950000E+01,103\r\n"
FAULT = "a fault, two digits and text"
VALUE = bytes.fromhex("FE 05 26 71 00 48 F7 80 09")
KINDS = {
    "chamber": (Chamber, "a state, five pairs of values"),
    "multiplexer": (Multiplexer, "2 readings, of (@101,103)"),
    "thermometer": (Thermometer, "its value, a reply of address 1 to code 0"),
}
each_kind = pytest.mark.parametrize("kind", KINDS)
LATE_S = FastClock.LEAST_PATIENCE_S * 1.2 * 20.0  # of a clock that is 20 times as fast


@each_kind
def test_an_answer_is_a_reading_between_question_and_answer(bench, kind) -> None:
    bench = bench(kind)
    began_s = bench.clock.now_s()
    reading = bench.driver.read()
    assert began_s <= reading.asked_s < reading.answered_s <= bench.clock.now_s()
    assert bench.reading() == pytest.approx(21.5, abs=0.1)


@each_kind
def test_an_answer_that_is_cut_short(bench, kind) -> None:
    bench = bench(kind)
    bench.driver.read()
    bench.simulated.twist(lambda reply: [(0.0, reply[:7])])
    error = bench.failure()
    assert error.expected == KINDS[kind][1]
    assert error.got.startswith("only ")
    assert not isinstance(error, Silent)
    assert bench.reading() == pytest.approx(21.5, abs=0.1)


@each_kind
def test_an_answer_that_lacks_its_beginning(bench, kind) -> None:
    bench = bench(kind)
    bench.driver.read()
    bench.simulated.twist(lambda reply: [(0.0, reply[4:])])
    assert bench.failure().expected == KINDS[kind][1]
    assert bench.reading() == pytest.approx(21.5, abs=0.1)


@each_kind
def test_an_answer_that_is_late_is_never_that_to_the_next_question(bench, kind) -> None:
    bench = bench(kind)
    bench.driver.read()
    bench.simulated.twist(lambda reply: [(LATE_S, reply)])
    error = bench.failure(Silent)
    assert error.expected in (KINDS[kind][1], "an error's number and text")
    bench.air_degC[0] = 40.0
    if kind == "multiplexer":
        bench.clock.sleep(25.0)  # its probes feel it late
    assert bench.reading() == pytest.approx(40.0, abs=0.1)


@each_kind
def test_answers_that_are_late_again_and_again_are_never_taken_for_another(bench, kind) -> None:
    bench = bench(kind)
    bench.driver.read()
    for _ in range(3):
        bench.simulated.twist(lambda reply: [(LATE_S, reply)])
    failures = 0
    bench.air_degC[0] = 40.0
    readings = []
    while len(readings) < 3:
        try:
            readings.append(bench.reading())
        except LineError:
            failures += 1
    assert 1 <= failures <= 4
    if kind != "multiplexer":
        assert readings == pytest.approx([40.0] * 3, abs=0.1)


@each_kind
@pytest.mark.parametrize("gap_s", [0.0, 0.01, 1.0])
def test_an_answer_that_comes_twice(bench, kind, gap_s) -> None:
    bench = bench(kind)
    bench.driver.read()
    bench.simulated.twist(lambda reply: [(0.0, reply), (gap_s, reply)])
    error = failure_of_two(bench)
    answer = KINDS[kind][1]
    expected = {f"{answer}, and nothing more", f"nothing before it was asked for {answer}"}
    if kind == "chamber":  # which is asked two questions at a time
        expected |= {f"nothing before it was asked for {FAULT}", FAULT}
    assert error.expected in expected
    assert (error.instrument, error.port) == (kind, bench.simulated.port)
    assert bench.reading() == pytest.approx(21.5, abs=0.1)


def failure_of_two(bench) -> LineError:
    """How the first or the second reading fails, the second answer having come in between."""
    for _ in range(2):
        try:
            bench.driver.read()
        except LineError as error:
            return error
        bench.clock.sleep(2.0)
    pytest.fail("neither reading failed")


@pytest.mark.parametrize(
    ("kind", "other"),
    [
        (kind, other)
        for kind, own in (("chamber", STATE), ("multiplexer", SCAN), ("thermometer", VALUE))
        for other in (STATE, b"0\r", SCAN, b'+0,"No error"\r\n', VALUE)
        if other != own
    ],
)
def test_an_answer_of_another_instrument_or_to_another_question(bench, kind, other) -> None:
    bench = bench(kind)
    bench.driver.read()
    bench.simulated.twist(lambda reply: [(0.0, other)])
    error = bench.failure()
    assert error.expected == KINDS[kind][1]
    assert not isinstance(error, Silent)
    assert bench.reading() == pytest.approx(21.5, abs=0.1)


@each_kind
@pytest.mark.parametrize("noise", [b"\x80", b"\xff\x00\xfe", b"hello\r\n"], ids=repr)
def test_noise_before_a_question(bench, kind, noise) -> None:
    bench = bench(kind)
    bench.driver.read()
    bench.simulated.say(noise)
    bench.clock.sleep(2.0)
    error = bench.failure()
    assert error.expected == f"nothing before it was asked for {KINDS[kind][1]}"
    assert bench.reading() == pytest.approx(21.5, abs=0.1)


@each_kind
def test_silence(bench, kind) -> None:
    bench = bench(kind)
    bench.driver.read()
    bench.simulated.mute()
    error = bench.failure(SwitchedOff if kind == "thermometer" else Silent)
    assert error.got.startswith("nothing in ")
    assert str(error).endswith("; switch it on") == (kind == "thermometer")
    bench.failure(Silent)
    bench.simulated.unmute()
    assert bench.reading() == pytest.approx(21.5, abs=0.1)


def test_an_instrument_that_babbles_does_not_hold_up_for_ever(bench) -> None:
    bench = bench("thermometer")
    ended = threading.Event()

    def babble() -> None:
        while not ended.is_set():
            bench.simulated.say(b"\x55" * 20)
            time.sleep(0.005)

    babbler = threading.Thread(target=babble)
    babbler.start()
    try:
        bench.failure()
    finally:
        ended.set()
        babbler.join()
    bench.clock.sleep(20.0)
    assert bench.reading() == pytest.approx(21.5, abs=0.1)


def test_several_threads_may_ask(bench) -> None:
    bench = bench("chamber")
    faults: list[LineError] = []

    def ask() -> None:
        for index in range(20):
            try:
                bench.driver.set_point(20.0 + index)
                bench.driver.read()
            except LineError as error:
                faults.append(error)

    threads = [threading.Thread(target=ask) for _ in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert faults == []
