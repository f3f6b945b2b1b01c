"""A made-up device whose right sensors are known, and small pieces of it."""

import numpy as np
import pytest
from scipy.signal import lfilter

from ambient_trainer.data.trace import Trace
from ambient_trainer.selection.resumable import ResumablePool
from ambient_trainer.selection.screen import screened
from ambient_trainer.selection.search import Options, prepared, searched

PERIOD_S = 2.0
SAMPLES = 1500
PAIR = ("left", "right")
"""Both feel one heat, in the ratio 2 to 1: together they tell the ambient, alone neither does."""
LONER = "loner"
"""The best single sensor, and of no use beside the pair: plain forward selection would keep it."""


def lagged(u, tau_s):
    a = np.exp(-PERIOD_S / tau_s)
    return lfilter([1 - a], [1, -a], u - u[0]) + u[0]


def walk(random, count, every, size):
    """Levels that change now and then."""
    return np.repeat(random.normal(scale=size, size=-(-count // every)), every)[:count]


def made_up(seed=0, count=SAMPLES, path="made-up.csv"):
    random = np.random.default_rng(seed)
    ambient = 20 + lagged(walk(random, count, 130, 8.0), 60.0)
    heat = lagged(walk(random, count, 70, 6.0), 25.0)
    own = lagged(walk(random, count, 90, 2.5), 40.0)

    def read(truth, noise=0.02):
        return np.round(truth + random.normal(scale=noise, size=count), 2)

    columns = {
        "chip_degC": read(40 + 3 * lagged(walk(random, count, 30, 6.0), 5.0) + lagged(ambient, 30.0), 0.1),
        "left_degC": read(lagged(ambient, 20.0) + 2 * heat),
        "loner_degC": read(lagged(ambient, 20.0) + own),
        "mixed_degC": read(lagged(ambient, 80.0) + lagged(walk(random, count, 50, 9.0), 15.0)),
        "right_degC": read(lagged(ambient, 20.0) + heat),
        "ambient_degC": np.round(ambient + random.normal(scale=0.02, size=count), 3),
    }
    return Trace(path, np.arange(count) * PERIOD_S, columns)


AGAIN = made_up(11, path="runs/again.csv")
"""Another draw of the device, which chooses nothing."""
OPTIONS = Options(most=2, order=2, blocks=6, tolerance_degC=0.05)


def data_of(*traces):
    """Traces screened, on their grid and cut in blocks."""
    return prepared(traces, *screened(traces), OPTIONS)


@pytest.fixture(scope="session")
def small():
    return data_of(made_up())


def found_in(trace, jobs, checks=(), with_circuits=True):
    with ResumablePool(jobs) as pool:
        return searched(data_of(trace), pool, [LONER, "right"], checks, with_circuits)


@pytest.fixture(scope="session")
def found():
    return found_in(made_up(), 1, [AGAIN])
