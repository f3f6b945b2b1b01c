"""What comes instead of an answer is an error that names instrument, port and what was expected; never a reading."""

import os
import select
import threading
import time
import tty
from concurrent.futures import ThreadPoolExecutor

import pytest

from ambient_trainer.laboratory.messages import Disconnected, NoResponse
from ambient_trainer.laboratory.pseudo_terminal import XOFF
from breaking import distort, mute, send

STATE = b"0010.0 0011.2 0000.0 0011.2 0000.0 0011.2 0000.0 0011.2 0000.0 0011.2 0101010101010100\r"
SCAN = b"+2.61950000E+01,101,+2.61950000E+01,103\r\n"
VALUE = bytes.fromhex("FE 05 26 71 00 48 F7 80 09")
EXPECTED = {"chamber": "a state", "multiplexer": "2 readings, of (@101,103)", "thermometer": "its value"}
OWN = {"chamber": STATE, "multiplexer": SCAN, "thermometer": VALUE}


@pytest.fixture(params=OWN)
def asked(bench, request):
    """The bench of each role, which has been asked once."""
    made = bench(request.param)
    made.driver.read()
    return made


def recovered(bench) -> None:
    assert bench.reading() == pytest.approx(21.5, abs=0.1)


def sends(made):
    """The next answer is what is made of it."""
    return lambda bench: distort(bench.simulated, made)


def noise(data):
    return lambda bench: (send(bench.simulated, data), bench.clock.sleep(2.0))


OTHERS = (STATE, b"0\r", SCAN, b'+0,"No error"\r\n', VALUE)
INSTEAD = {
    **{repr(other): sends(lambda reply, other=other: other) for other in OTHERS},
    "cut short": sends(lambda reply: reply[:7]),
    "without its start": sends(lambda reply: reply[4:]),
    "noise before it": noise(b"\x80"),
    "text before it": noise(b"hello\r\n"),
}


@pytest.mark.parametrize(
    ("role", "what"), [(role, what) for role in OWN for what in INSTEAD if what != repr(OWN[role])]
)
def test_what_is_no_answer_or_that_to_another_question(bench, role, what):
    bench = bench(role)
    bench.driver.read()
    INSTEAD[what](bench)
    error = bench.failure()
    before = "nothing before it was asked for " if what.endswith("before it") else ""
    assert error.expected.startswith(before + EXPECTED[role])
    assert not isinstance(error, NoResponse)
    recovered(bench)


def test_silence(asked):
    mute(asked.simulated)
    error = asked.failure(NoResponse)
    assert (error.hint == "switch it on") == (asked.role == "thermometer")
    asked.failure(NoResponse)
    mute(asked.simulated, False)
    recovered(asked)


def test_an_instrument_that_sends_all_the_time_does_not_hold_up_for_ever(bench):
    bench = bench("thermometer")
    ended = threading.Event()

    def keep_sending() -> None:
        while not ended.is_set():
            send(bench.simulated, b"\x55" * 20)
            time.sleep(0.005)

    sender = threading.Thread(target=keep_sending)
    sender.start()
    try:
        bench.failure()
    finally:
        ended.set()
        sender.join()
    bench.clock.sleep(20.0)
    recovered(bench)


def test_several_threads_may_ask(bench):
    bench = bench("chamber")

    def ask(_: int) -> None:
        for index in range(10):
            bench.driver.set_point(20.0 + index)
            bench.driver.read()

    with ThreadPoolExecutor(3) as threads:
        list(threads.map(ask, range(3)))  # an error of any comes out here


def test_a_cable_that_is_pulled_and_put_in_again_and_a_port_that_went_is_let_go(asked):
    held, errors = [], []
    for _ in range(5):
        recovered(asked)
        asked.simulated.unplug()
        errors += [asked.failure(Disconnected) for _ in range(2)]  # with the frames that the port was used in
        asked.simulated.plug()
        held.append(len(os.listdir("/proc/self/fd")))
    assert held[-1] == held[0]


def test_a_cable_that_is_pulled_in_the_middle_of_an_answer(asked):
    distort(asked.simulated, lambda reply: reply[:3])
    puller = threading.Timer(0.1, asked.simulated.unplug)
    puller.start()
    asked.failure(Disconnected)
    puller.join()
    asked.simulated.plug()
    recovered(asked)


def test_a_port_that_is_in_use(asked, driver_at):
    second = driver_at(asked.role, asked.simulated.port, asked.clock)
    with pytest.raises(Disconnected) as caught:
        second.read()
    assert "in use" in caught.value.got
    asked.driver.close()
    assert second.read()


def test_an_instrument_that_stops_the_sender_does_not_hold_up_for_ever(bench):
    bench = bench("multiplexer")
    bench.driver.read()
    send(bench.simulated, XOFF)
    bench.clock.sleep(2.0)
    assert "XOFF" in bench.failure(NoResponse).got
    recovered(bench)


def test_a_port_that_is_closed_after_a_command_sends_it_to_the_end(driver_at):
    for _ in range(8):  # once, the race may be won
        far, near = os.openpty()
        tty.setraw(near)
        driver = driver_at("chamber", os.ttyname(near), timeout_s=0.1)
        with pytest.raises(NoResponse):
            driver.stop()
        driver.close()
        got = b""
        while b"$00E 0020.0" not in got and select.select([far], [], [], 0.5)[0]:
            got += os.read(far, 4096)
        assert b"$00E 0020.0" in got
        os.close(far)
        os.close(near)
