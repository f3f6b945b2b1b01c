"""A diagnosis as the search would make it, from made residuals."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from ambient_studies.discovery.outcome import Outcome
from ambient_trainer.diagnosis.residual_tests import residual_tests
from ambient_trainer.diagnosis.result import Cause, Diagnosis, Gain, Magnitude, Misfit, Ranked, Step

CAMERA = Cause("heat_source", "flash", "camera_on")
CASE = Cause("ambient_coupling", "battery")
SAMPLES, PERIOD_S = 720, 10.0


def _diagnosis(**changes: object) -> Diagnosis:
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
        ("The first 10 min were taken to settle.",),
    )  # fmt: skip
    return replace(made, **changes)


@pytest.fixture(scope="session")
def made() -> Callable[..., Diagnosis]:
    """A diagnosis of two effects, with whatever is given changed."""
    whole = _diagnosis()
    return lambda **changes: replace(whole, **changes)


def _outcomes() -> list[Outcome]:
    random = np.random.default_rng(4)
    causes = [CAMERA, CASE, Cause("contact"), Cause("sensor_bias", "usb"), Cause("clock_offset"), Cause("path", "a-b")]
    outcomes = []
    for _ in range(300):
        cause, size = causes[random.integers(len(causes))], float(np.exp(random.uniform(-1.5, 3.5)))
        right = bool(random.random() < 1 / (1 + (1.5 / size) ** 2))
        wrong = () if random.random() < 0.6 else (causes[random.integers(len(causes))],)
        found = (cause,) if right else wrong
        outcomes.append(
            Outcome((cause,), size, found, found == (cause,), 0.1 if right else None, 20.0 if right else None,
                    (0.01, 0.2) if found else None, 4.0)
        )  # fmt: skip
    outcomes += [Outcome((), 0.0, (), True, None, None, None, 2.0)] * 58
    outcomes += [Outcome((), 0.0, (Cause("unknown"),), False, None, None, (0.001, 0.1), 3.0)] * 2
    outcomes += [Outcome((CAMERA, CASE), 6.0, (CASE, CAMERA), True, 0.05, 10.0, (0.1, 0.2), 8.0)] * 30
    outcomes += [Outcome((CAMERA, CASE), 6.0, (CASE,), False, 0.05, 10.0, (0.1, 0.2), 8.0)] * 10
    return outcomes


@pytest.fixture(scope="session")
def outcomes() -> list[Outcome]:
    """A benchmark of 400 cases."""
    return _outcomes()
