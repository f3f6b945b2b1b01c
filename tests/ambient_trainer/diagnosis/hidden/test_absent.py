"""Physics that no mechanism of the library has: where and by what is found all the same, and no wrong name is sure."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from ambient_trainer.data.trace import Trace
from ambient_trainer.diagnosis.diagnose import diagnose
from ambient_trainer.diagnosis.result import NONE, UNKNOWN

SAMPLES, PERIOD_S, GRID_S = 1080, 10.0, 20.0
HEAT_CAPACITIES = np.array([8.0, 30.0, 80.0])
SEED = 6
SURE = 0.9

pytestmark = pytest.mark.slow

Heats = Callable[[np.ndarray, float, dict[str, float], dict[str, float], float], tuple[float, float, float]]
"""Heat into chip, board and shell from their temperatures, the air's, the log, what is remembered, and a size."""


def switches_by_itself(nodes, air, log, kept, size):
    """A heater with hysteresis."""
    kept["on"] = nodes[2] < kept["warm"] + 3.0 * kept.get("on", 0.0)
    return 0, 0, 1.5 * size * kept["on"]


def leaks(nodes, air, log, kept, size):
    """Heat that grows with the square of the temperature."""
    return 3.5e-4 * size * max(nodes[0] - 10, 0) ** 2, 0, 0


def opens(nodes, air, log, kept, size):
    """A valve."""
    return 0, -0.2 * size * (nodes[1] - air) * (nodes[1] > kept["hot"]), 0


def loses_by_humidity(nodes, air, log, kept, size):
    return 0, 0, -0.4 * size * log["humidity_frac"] * (nodes[2] - air)


def pumps(nodes, air, log, kept, size):
    """A Peltier element."""
    heat = 0.6 * size * log["battery_current_A"]
    return 0, -heat, heat


def rubs(nodes, air, log, kept, size):
    """Heat by the cube of a speed."""
    return 0, 2.0 * size * (log["fan_rpm"] / 3000) ** 3, 0


def reacts(nodes, air, log, kept, size):
    """Heat that decays after something was switched on."""
    begun = log["radio_on"] > kept.get("was", log["radio_on"])
    kept["heat"] = kept.get("heat", 0.0) * np.exp(-PERIOD_S / 400) + 2.5 * size * begun
    kept["was"] = log["radio_on"]
    return 0, 0, kept["heat"]


def saturates(nodes, air, log, kept, size):
    return 0, 1.5 * size * min(log["load_frac"] / 0.35, 1.0), 0


def radiates(nodes, air, log, kept, size):
    """Into a sky that nobody logs."""
    return 0, 0, -4e-9 * size * ((nodes[2] + 273.15) ** 4 - (air + 255.15) ** 4)


def dries(nodes, air, log, kept, size):
    return 0, 0, -0.12 * size * max(nodes[2] - 8, 0) * log["wet_on"]


ABSENT: dict[Heats, tuple[set[str], str | None]] = {
    switches_by_itself: ({"shell"}, None),
    leaks: ({"chip"}, None),
    opens: ({"board"}, None),
    loses_by_humidity: ({"shell"}, "humidity_frac"),
    pumps: ({"board", "shell"}, "battery_current_A"),
    rubs: ({"board"}, "fan_rpm"),
    reacts: ({"shell"}, "radio_on"),
    saturates: ({"board"}, "load_frac"),
    radiates: ({"shell"}, None),
    dries: ({"shell"}, "wet_on"),
}


def test_place_and_driver_of_what_is_absent(box):
    right, surely_wrong = [], []
    for heats, (places, driver) in ABSENT.items():
        found = diagnose(box, [_trace(heats)], period_s=GRID_S)
        cause = found.verdict_cause
        assert cause.name != NONE
        location = {cause.location} if isinstance(cause.location, str) else set(cause.location or ())
        if location == places and (cause.signal is None if driver is None else driver in (cause.signal or "")):
            right.append(heats.__name__)
        elif cause.name != UNKNOWN and found.verdict.confidence >= SURE:
            surely_wrong.append((heats.__name__, str(cause), found.verdict.confidence))
    assert len(right) >= 7, right
    assert not surely_wrong


@pytest.mark.parametrize("delay_s", [420.0, 700.0])
def test_a_delay_is_measured(box, delay_s):
    def heats(nodes, air, log, kept, size):
        kept.setdefault("past", []).append(log["radio_on"])
        return 0, 0.8 * size * kept["past"][max(len(kept["past"]) - 1 - int(delay_s / PERIOD_S), 0)], 0

    found = diagnose(box, [_trace(heats)], period_s=GRID_S)
    assert found.verdict_cause.name == "heat_source"
    assert found.verdict_cause.signal.startswith("delay(radio_on, ")
    assert float(found.verdict_cause.signal.split()[1].rstrip(")")) == pytest.approx(delay_s, abs=GRID_S)


def test_heat_into_two_of_three_places_is_not_said_of_the_third(box):
    def heats(nodes, air, log, kept, size):
        return 1.2 * size * log["load_frac"], 0, 1.5 * size * log["load_frac"]

    cause = diagnose(box, [_trace(heats)], period_s=GRID_S).verdict_cause
    assert (cause.name, cause.location, cause.signal) == ("heat_source", ("chip", "shell"), "load_frac")


def _trace(heats: Heats) -> Trace:
    random = np.random.default_rng([SEED, *heats.__name__.encode()])
    time_s = PERIOD_S * np.arange(SAMPLES)
    jumps = np.where(random.random(SAMPLES) < 0.004, random.normal(0, 4, SAMPLES), 0.0)
    air = 18 + 5 * np.sin(time_s / random.uniform(1500, 2500) + random.uniform(0, 6)) + np.cumsum(jumps)
    power = _switched(random, 700) * random.uniform(2, 3) + _switched(random, 1500) * random.uniform(0.5, 1)
    log = {
        "radio_on": _switched(random, 900),
        "wet_on": _switched(random, 900),
        "fan_rpm": np.round(1000 + 2000 * _wandering(random)),
        "humidity_frac": 0.2 + 0.7 * _wandering(random),
        "load_frac": _wandering(random),
        "battery_current_A": _switched(random, 600) * random.uniform(1, 2)
        - _switched(random, 800) * random.uniform(0.5, 2),
    }
    size = random.uniform(0.8, 1.25)
    bare = _integrated(lambda *given: (0, 0, 0), air, power, log, {}, size)
    kept = {"warm": float(np.quantile(bare[2], 0.6)), "hot": float(np.quantile(bare[1], 0.6))}
    read = _integrated(heats, air, power, log, kept, size) + 0.05 * random.standard_normal((3, SAMPLES))
    columns = {
        "ambient_degC": air + 0.02 * random.standard_normal(SAMPLES),
        "chip_power_W": power,
        **dict(zip(("chip_degC", "board_degC", "shell_degC"), read)),
        **log,
    }
    return Trace(f"{heats.__name__}.csv", time_s, columns)


def _switched(random: np.random.Generator, typical_s: float) -> np.ndarray:
    lengths = (random.uniform(0.5, 1.5, SAMPLES) * typical_s / PERIOD_S).astype(int) + 1
    return (np.repeat(np.arange(SAMPLES), lengths)[:SAMPLES] + random.integers(2)) % 2.0


def _wandering(random: np.random.Generator) -> np.ndarray:
    walk = np.cumsum(random.normal(size=SAMPLES))
    return (walk - walk.min()) / np.ptp(walk)


def _integrated(heats: Heats, air, power, log, kept, size) -> np.ndarray:
    """Chip, board and shell in degC, (3, N); what is absent holds for a sample, air and power are straight lines."""
    nodes = np.full(3, air[0])
    found = [nodes]
    for index in range(SAMPLES - 1):
        extra = np.array(heats(nodes, air[index], {name: row[index] for name, row in log.items()}, kept, size))

        def rates(passed_s, nodes, index=index, extra=extra):
            share = passed_s / PERIOD_S
            outside, into_chip = (row[index] + share * (row[index + 1] - row[index]) for row in (air, power))
            into_board, into_shell = 0.2 * (nodes[0] - nodes[1]), 0.3 * (nodes[1] - nodes[2])
            loss = 0.25 * (nodes[2] - outside)
            flows = np.array([into_chip - into_board, into_board - into_shell, into_shell - loss])
            return (flows + extra) / HEAT_CAPACITIES

        nodes = solve_ivp(rates, (0, PERIOD_S), nodes, rtol=1e-6, atol=1e-6).y[:, -1]
        found.append(nodes)
    return np.array(found).T
