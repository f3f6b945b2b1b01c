"""Trouble of any kind in any order costs readings; it never makes a wrong one."""

from __future__ import annotations

import numpy as np
import pytest

from ambient_trainer.laboratory.line import LineError

LATE_S = 12.0  # longer than either is waited for


@pytest.mark.parametrize("kind", ["chamber", "thermometer"])
@pytest.mark.parametrize("seed", range(2))
def test_whatever_happens_a_reading_is_of_the_time_between_question_and_answer(bench, kind, seed) -> None:
    bench = bench(kind)
    random = np.random.default_rng(seed)
    simulated, per_s = bench.simulated, 0.2  # the air tells the time

    def air_degC(at_s: float) -> float:
        return at_s * per_s

    simulated._ambient = air_degC
    if kind == "chamber":
        simulated._air.at = air_degC
    deeds = [
        lambda: simulated.twist(lambda reply: [(0.0, reply[: int(random.integers(len(reply)))])]),
        lambda: simulated.twist(lambda reply: [(0.0, reply), (float(random.uniform(0.0, 3.0)), reply)]),
        lambda: simulated.twist(lambda reply: [(float(random.uniform(0.5, 1.5)) * LATE_S, reply)]),
        lambda: simulated.twist(lambda reply: [(0.0, reply[:3]), (1.0, reply[3:])]),
        lambda: simulated.say(random.bytes(int(random.integers(1, 12)))),
        lambda: (simulated.unplug(), simulated.plug()),
    ]
    readings = failures = 0
    while readings < 5 or failures < 5:
        deed = int(random.integers(2 * len(deeds)))
        if deed < len(deeds):
            deeds[deed]()
        try:
            reading = bench.driver.read()
        except LineError:
            failures += 1
            continue
        readings += 1
        value_degC = reading.actual_degC if kind == "chamber" else reading.temp_degC
        assert reading.asked_s - 0.5 <= value_degC / per_s <= reading.answered_s + 0.5
