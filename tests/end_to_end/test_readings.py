"""Missing and wrong readings on a simulated phone, fitted on one scenario and run on another as the daemon does."""

import copy
import itertools
from functools import cache

import numpy as np
import pytest

from ambient_trainer.estimators.base import Effort
from ambient_trainer.estimators.library.free import FreeFilterEstimator
from ambient_trainer.estimators.model_file import model_of
from ambient_trainer.estimators.readings import reading_model
from ambient_trainer.evaluation.stress import FAULTS
from ambient_trainer.simulator.simulate import simulate
from ambientd.fallback import FallbackTracker

pytestmark = pytest.mark.slow

NOTICED_S = 10
REST_S, LOAD_S = 12_000, 23_760
"""Chamber and load are steady; the processor's load began a minute before."""


@cache
def model():
    trace = simulate("5", seed=3).trace
    columns = ("soc_degC", "flash_degC", "battery_degC", "usb_degC", "display_degC")
    fit = FreeFilterEstimator(2).fit([trace], Effort(starts=1), None, None, columns)
    return model_of(fit, [], {}, reading_model(fit, [trace]))


@cache
def run():
    """Readings (n, m) and ambient (n,) of another run."""
    trace = simulate("4", seed=12).trace
    return np.column_stack([trace.column(each.column) for each in model().main.inputs]), trace.reference


@cache
def tracker_at(onset: int) -> FallbackTracker:
    """Run in on right readings for 90 minutes."""
    tracker = FallbackTracker(model(), 1.0)
    for k, row in enumerate(run()[0][max(0, onset - 5400) : onset].tolist(), start=max(0, onset - 5400)):
        tracker.update(float(k), row)
    return tracker


def off_while_tracking(fault: str, sensors: tuple[int, ...], onset: int, lasts: int) -> float:
    """The largest error of a sample marked ``tracking``, from 10 s after the sensors became wrong."""
    tracker, (u, ambient) = copy.deepcopy(tracker_at(onset)), run()
    right = u[onset : onset + lasts]
    wrong = right.copy()
    for i in sensors:
        wrong[:, i] = FAULTS[fault](right, i)
    errors = [0.0]
    for k, row in enumerate(wrong.tolist()):
        estimate = tracker.update(float(onset + k), row)
        if k > NOTICED_S and estimate.status == "tracking":
            errors.append(abs(estimate.ambient_degC - ambient[onset + k]))
    return max(errors)


@pytest.mark.parametrize("onset", [REST_S, LOAD_S])
@pytest.mark.parametrize("fault", FAULTS)
def test_wrong_sensors_are_not_tracked(fault, onset):
    sets = [(i,) for i in range(5)] + list(itertools.combinations(range(5), 2))
    off = {each: off_while_tracking(fault, each, onset, 600) for each in sets}
    assert max(off.values()) < 2.0, off


def rmse_degC(share: float, samples: int) -> float:
    """Of the estimate with that share of the readings missing."""
    u, ambient = run()
    gone = np.random.default_rng(1).random(u.shape) < share
    tracker = FallbackTracker(model(), 1.0)
    rows = np.where(gone, np.nan, u)[:samples].tolist()
    found = [tracker.update(float(k), [None if v != v else v for v in row]) for k, row in enumerate(rows)]
    estimate = np.array([each.ambient_degC for each in found], dtype=float)
    return float(np.sqrt(np.mean((estimate - ambient[:samples]) ** 2)))


@pytest.mark.parametrize(("share", "at_most"), [(0.01, 1.1), (0.1, 1.2)])
def test_missing_readings_cost_little(share, at_most):
    assert rmse_degC(share, 6000) <= at_most * rmse_degC(0.0, 6000)
