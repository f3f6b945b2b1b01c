"""A diagnosis as the search would make it, from made residuals."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.signal import lfilter

from ambient_trainer.data.trace import Trace
from ambient_trainer.diagnosis.residual_tests import residual_tests
from ambient_trainer.diagnosis.result import Cause, Diagnosis, Gain, Magnitude, Misfit, Ranked, Step

CAMERA = Cause("heat_source", "flash", "camera_on")
CASE = Cause("ambient_coupling", "battery")
SAMPLES, PERIOD_S = 720, 10.0
BOX_SAMPLES, BOX_PERIOD_S = 1080, 10.0


def made_diagnosis(**changes: object) -> Diagnosis:
    random = np.random.default_rng(3)
    time_s = PERIOD_S * np.arange(SAMPLES)
    camera = ((time_s > 3600) & (time_s < 5400)) * 1.0
    ambient = 20 + 4 * np.sin(time_s / 3000)
    load = (np.sin(time_s / 700) > 0.4) * 1.0
    base = ambient + 8 + 5 * lfilter([0.02], [1, -0.98], load)
    simulated = np.stack([base + 2, base])
    noise = 0.08 * random.standard_normal((2, SAMPLES))
    warm = 3.0 * lfilter([0.03], [1, -0.97], camera)
    drop = -0.8 * lfilter([0.02], [1, -0.98], (time_s > 2000) * 1.0)
    residual = noise + np.stack([warm, drop])
    heat = np.gradient(residual, PERIOD_S, axis=1) + residual / 330
    measured = simulated + residual
    measured[1, 100:130] = np.nan
    steps = (
        Step(
            CAMERA, 3600.0, 5400.0, Magnitude(0.82, "W", "heat into flash while camera_on is 1", (0.78, 0.86)), 0.998,
            Gain(0.91, 0.43, (0.40, 0.55), 2e-5), (Cause("contact", "flash"),),
            "Heat of 0.82 W flows into flash while camera_on is 1.",
            {"power": (0.82, "W")}, noise + np.stack([0 * warm, drop]),
        ),
        Step(
            CASE, 2000.0, None, Magnitude(-0.31, "1", "relative change of the resistance", (-0.36, -0.27)), 0.97,
            Gain(0.43, 0.08, (0.3, 0.4), 0.004), (),
            "The resistance to the ambient at battery is 31 % lower from 0:33:20 on.",
            {"factor": (0.69, "1"), "onset": (2000.0, "s")}, noise,
        ),
    )  # fmt: skip
    ranking = (
        Ranked(CAMERA, 3600.0, 5400.0, steps[0].magnitude, steps[0].gain, "taken"),
        Ranked(Cause("contact", "flash"), 3590.0, 5420.0, Magnitude(41.0, "degC", "body", (38, 45)),
               Gain(0.91, 0.47, (0.35, 0.5), 1e-4), "explains the same with more parameters"),
        Ranked(Cause("sensor_drift", "flash"), None, None, None, Gain(0.91, 0.9, (-0.02, 0.04), 0.6),
               "no more than chance"),
    )  # fmt: skip
    tests = residual_tests(
        time_s, measured - simulated, heat, ("flash", "battery"), {"camera_on": camera, "cpu_load_frac": load},
        ambient, measured,
    )  # fmt: skip
    made = Diagnosis(
        "/data/day.csv", "two_nodes", ("/data/known-good.csv",), time_s,
        {"camera_on": camera, "cpu_load_frac": load, "ambient_degC": ambient},
        Misfit(("flash", "battery"), measured, simulated, heat, "K/s", tests, 0.3 * residual[0]),
        steps, steps[0], ranking,
        "switch camera_on on for 20 min and off for 20 min: the two then differ by 0.4 degC, three sigma.", None, 57,
        0.91, ("The first 10 min were taken to settle.",),
    )  # fmt: skip
    return replace(made, **changes)


@pytest.fixture(scope="session")
def made() -> Callable[..., Diagnosis]:
    """A diagnosis of two effects, with whatever is given changed."""
    whole = made_diagnosis()
    return lambda **changes: replace(whole, **changes)


@pytest.fixture(scope="session")
def boxed() -> Callable[..., Trace]:
    """Three hours of a box, integrated to 1e-6; by name what it has that its circuit lacks; in a room, or outdoors."""
    return _boxed


def _boxed(lacks: str, seed: int, room_degC: float | None = None) -> Trace:
    random = np.random.default_rng([seed, 7])
    time_s = BOX_PERIOD_S * np.arange(BOX_SAMPLES)
    jumps = np.where(random.random(BOX_SAMPLES) < 0.004, random.normal(0, 4, BOX_SAMPLES), 0.0)
    air = 18 + 5 * np.sin(time_s / random.uniform(1500, 2500) + random.uniform(0, 6)) + np.cumsum(jumps)
    if room_degC is not None:
        air = np.full(BOX_SAMPLES, room_degC)
    power = _switched(random, 700) * random.uniform(2, 3) + _switched(random, 1500) * random.uniform(0.5, 1)
    radio, fan = _switched(random, 500), _switched(random, 900)
    current = _switched(random, 600) * random.uniform(1, 2) - _switched(random, 800) * random.uniform(0.5, 2)
    size = random.uniform(0.8, 1.3)
    true_degC = _integrated(lacks, size, np.array([air, power, radio, current]))
    read_degC = _read(lacks, size, true_degC) + 0.05 * random.standard_normal(true_degC.shape)
    logged = np.interp(time_s - 150 * size, time_s, air) if lacks == "clock_offset" else air
    for layer_s in (20 * size, 130 * size) if lacks == "reference_lag" else ():
        share = 1 - np.exp(-BOX_PERIOD_S / layer_s)
        logged = lfilter([share], [1, share - 1], logged, zi=[(1 - share) * air[0]])[0]
    columns = {
        "ambient_degC": logged + (0.02 * random.standard_normal(BOX_SAMPLES) if room_degC is None else 0.0),
        "chip_power_W": power,
        **dict(zip(("chip_degC", "board_degC", "shell_degC"), read_degC)),
        "radio_on": radio,
        "fan_on": fan,
        "battery_current_A": current,
    }
    return Trace(f"{lacks}-{seed}.csv", time_s, columns)


def _switched(random: np.random.Generator, typical_s: float) -> np.ndarray:
    row, index, on = np.zeros(BOX_SAMPLES), 0, bool(random.integers(2))
    while index < BOX_SAMPLES:
        lasting = int(random.uniform(0.5, 1.5) * typical_s / BOX_PERIOD_S)
        row[index : index + lasting] = on
        index, on = index + lasting, not on
    return row


def _integrated(lacks: str, size: float, inputs: np.ndarray) -> np.ndarray:
    """Chip, board and shell in degC, (3, samples); the inputs are straight lines between their samples."""

    def rates(nodes: np.ndarray, air: float, power: float, radio: float, current: float) -> list[float]:
        chip, board, shell, body = nodes
        difference = shell - air
        bent = (abs(difference) / 8) ** (0.35 * size) if lacks == "convection_law" else 1.0
        loss = (0.15 if lacks == "ambient_coupling" else 0.25) * difference * bent
        into_board, into_shell = 0.2 * (chip - board), 0.3 * (board - shell)
        past_the_board = 0.08 * size * (chip - shell) if lacks == "path" else 0.0
        into_body = 0.3 * size * (shell - body) if lacks == "thermal_mass" else 0.0
        from_radio = 0.6 * size * radio if lacks == "heat_source" else 0.0
        from_current = 0.35 * size * current**2 if lacks == "current_squared" else 0.0
        return [
            (power - into_board - past_the_board) / 8,
            (into_board - into_shell + from_current) / 30,
            (into_shell + past_the_board + from_radio - into_body - loss) / 80,
            into_body / 120,
        ]

    nodes = np.full(4, inputs[0, 0])
    found = [nodes]
    for now, then in zip(inputs.T[:-1], inputs.T[1:]):

        def within(passed_s: float, nodes: np.ndarray, now: np.ndarray = now, then: np.ndarray = then) -> list[float]:
            return rates(nodes, *(now + (then - now) * passed_s / BOX_PERIOD_S))

        nodes = solve_ivp(within, (0, BOX_PERIOD_S), nodes, method="DOP853", rtol=1e-6, atol=1e-6).y[:, -1]
        found.append(nodes)
    return np.array(found).T[:3]


def _read(lacks: str, size: float, true_degC: np.ndarray) -> np.ndarray:
    read = true_degC.copy()
    if lacks == "sensor_lag":
        share = 1 - np.exp(-BOX_PERIOD_S / (60 * size))
        for index in range(1, BOX_SAMPLES):
            read[0, index] = read[0, index - 1] + share * (true_degC[0, index] - read[0, index - 1])
    if lacks == "sensor_gain":
        read[1] = 25 + (1 + 0.12 * size) * (read[1] - 25)
    return read
