"""The error on later time, against responses of a first-order lag in closed form."""

import numpy as np
import pytest

import ambient_trainer as at
from ambient_trainer.data.trace import Trace
from ambient_trainer.diagnosis.later import later_errors
from ambient_trainer.lti.lag import lagged
from refusals import refused

from ..conftest import in_air

PERIOD_S, SAMPLES, FROM_S = 10.0, 600, 4000.0
TIME_S = PERIOD_S * np.arange(SAMPLES)


BARE, HEATED = (
    in_air("cell", 50, 10, source) for source in ("", "sources: [{into: cell, signal: heater_W, share: 1}]")
)


@pytest.fixture
def trace():
    """A heater of 1 W, on from the start and off in the middle of what is scored; the cell starts at 30 degC."""
    heater = (TIME_S < 5000) * 1.0
    degC = lagged(20 + 10 * heater, 500.0, PERIOD_S)
    return Trace("cell.csv", TIME_S, {"cell_degC": degC, "ambient_degC": np.full(SAMPLES, 20.0), "heater_W": heater})


def test_the_circuit_that_made_the_trace_leaves_nothing(trace):
    later = later_errors(BARE, HEATED, [trace], FROM_S)
    assert later.extended_rmse_degC < 1e-6
    assert later.samples == 200
    # without the heater its start, fitted to the time before, has decayed: what is left is the heater's response
    left = trace.columns["cell_degC"][TIME_S >= FROM_S] - 20
    assert later.bare_rmse_degC == pytest.approx(np.sqrt(np.mean(left**2)), rel=0.01)


def test_no_reading_of_the_scored_time_enters_the_simulation(trace):
    shifted = np.where(TIME_S >= FROM_S, 7.0, 0.0)
    trace.columns["cell_degC"] += shifted
    assert later_errors(HEATED, None, [trace], FROM_S).bare_rmse_degC == pytest.approx(7.0, abs=1e-6)


def test_a_time_after_the_end_is_refused_before_the_search(trace):
    def never(*given):
        raise AssertionError(given)

    assert "--later" in str(refused(at.diagnose, trace, HEATED, later_from_s=1e6, progress=never))


def test_a_stretch_after_a_gap_starts_from_its_first_reading(trace):
    there = (TIME_S < FROM_S - 500) | (TIME_S >= FROM_S + 500)
    gapped = Trace("gap.csv", TIME_S[there], {name: row[there] for name, row in trace.columns.items()})
    later = later_errors(HEATED, None, [gapped], FROM_S)
    assert (later.bare_rmse_degC, later.extended_rmse_degC) == pytest.approx((0.0, 0.0), abs=1e-6)
    assert later.samples == 150
