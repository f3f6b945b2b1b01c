"""Every method, trained once on a simulated phone; synthetic sensors that move independently; the thesis's text."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from ambient_studies.thesis.reproduction import Runs, all_methods
from ambient_trainer.data.trace import Trace
from ambient_trainer.estimation.search import Budget
from ambient_trainer.estimators.base import Effort
from ambient_trainer.simulator import simulate

PERIOD_S = 60.0
"""Slower than a phone logs: what is trained only has to be trained, not to be good."""


@pytest.fixture(scope="session")
def runs():
    scenarios = ("2.1", "2.2", "3")
    return Runs(
        simulate("5", seed=11, period_s=PERIOD_S).trace,
        simulate("1", seed=12, period_s=PERIOD_S).trace,
        {name: simulate(name, seed=13, period_s=PERIOD_S).trace for name in scenarios},
    )


@pytest.fixture(scope="session")
def methods(runs):
    """By name and variant."""
    with pytest.MonkeyPatch.context() as patch:
        # whether an estimate is causal does not depend on how good it is
        patch.setattr("ambient_studies.thesis.methods.EFFORT", Effort(starts=1, budget=Budget(evaluations=3)))
        found = all_methods(runs, lambda what, done, total: None)
    assert len({(each.name, each.variant) for each in found}) == len(found)
    return {(each.name, each.variant): each for each in found}


def wandering(samples: int, seed: int, period_s: float = 5.0) -> Trace:
    """Five smooth, independent temperatures about 25 degC, a battery current up to 2 A out of it, an idle half."""
    rng = np.random.default_rng(seed)

    def smooth(width: float) -> np.ndarray:
        found = gaussian_filter1d(rng.standard_normal(samples), width, mode="wrap")
        return found / found.std()

    sensors = ("soc_degC", "flash_degC", "battery_degC", "usb_degC", "display_degC")
    columns = {name: 25.0 + 8.0 * smooth(4.0 + 3.0 * index) for index, name in enumerate(sensors)}
    busy = (np.arange(samples) // (samples // 8)) % 2
    columns["ambient_degC"] = 20.0 + 5.0 * smooth(20.0)
    columns["cpu_load_frac"] = np.where(busy == 1, 0.8, 0.02)
    columns["charging_on"] = np.zeros(samples)
    columns["battery_current_A"] = -np.abs(smooth(5.0))
    return Trace(f"synthetic {seed}", np.arange(samples) * period_s, columns)


@pytest.fixture
def thesis_file(beside):
    """Reads a file of the thesis."""
    return lambda name: beside(f"thesis/{name}").read_text(encoding="utf-8")
