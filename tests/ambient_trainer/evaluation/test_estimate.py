"""Estimates over whole arrays are the device's, sample by sample, to 1e-9 degC."""

from dataclasses import replace

import numpy as np
import pytest

from ambient_model.faults import Refused
from ambient_model.model import Discrete, Estimator, Input
from ambient_model.tracking import Tracker
from ambient_trainer.data.trace import Array, Trace
from ambient_trainer.estimators.estimate import estimate_degC
from ambient_trainer.lti.discretise import discretised
from ambient_trainer.lti.statespace import StateSpace

INPUTS = ("usb_degC", "battery_degC")
SYSTEM = StateSpace(
    A=np.array([[-0.02, 0.01], [0.001, -0.003]]),
    B=np.array([[0.01, 0.0], [0.0, 0.002]]),
    C=np.array([[-0.4, 0.9]]),
    D=np.array([[0.3, 0.2]]),
    offset=np.array([-1.5]),
)


def by_tracker(system: StateSpace, trace: Trace, period_s: float) -> Array:
    found = discretised(system, period_s, "first-order")
    discrete = Discrete(period_s, *(tuple(map(tuple, each.tolist())) for each in (found.A, found.B, found.C, found.D)))
    estimator = Estimator(
        inputs=tuple(Input(name.removesuffix("_degC"), "degC", "", -1e9, 1e9) for name in INPUTS),
        states=("fast", "slow"),
        discrete=(discrete,),
        offset=float(system.offset[0]),
        initial=tuple(map(tuple, (-np.linalg.solve(system.A, system.B)).tolist())),
        interval={90: (0.0, 0.0)},
    )
    tracker = Tracker(estimator, discrete)
    rows = zip(*(trace.columns[name].tolist() for name in INPUTS))
    readings = [[None if value != value else value for value in row] for row in rows]
    said = [tracker.update(now, row).ambient_degC for now, row in zip(trace.time_s.tolist(), readings)]
    return np.array(said, dtype=float)


@pytest.mark.parametrize("period_s", [0.1, 1.0, 10.0])
def test_whole_with_missing_values_and_with_gaps(trace_of, period_s):
    whole = trace_of(600, period_s=period_s)
    usb = whole.columns["usb_degC"].copy()
    usb[[0, 50, 51, 200]] = np.nan
    usb[300:360] = np.nan
    holes = replace(whole, columns={**whole.columns, "usb_degC": usb})
    kept = np.delete(np.arange(600), [100, 101, *range(400, 480)])
    gaps = replace(holes, time_s=holes.time_s[kept], columns={k: v[kept] for k, v in holes.columns.items()})
    for each in (whole, holes, gaps):
        found = estimate_degC(SYSTEM, "first-order", INPUTS, each)
        np.testing.assert_allclose(found, by_tracker(SYSTEM, each, period_s), rtol=0, atol=1e-9)
        assert np.isnan(found[0]) == (each is not whole)
        assert np.isfinite(found[50])


def test_an_unstable_system_ends_in_no_estimate(trace_of):
    """One mode grows by e in two seconds; a decoupled one and the samples before it diverges are untouched."""
    growing = replace(SYSTEM, A=np.diag([0.5, -0.01]), C=np.array([[1.0, 0.5]]))
    trace = trace_of(4000)
    found = estimate_degC(growing, "first-order", INPUTS, trace)
    told = np.isfinite(found)
    first = int(np.argmin(told))
    assert 20 < first < 100
    assert not told[first:].any()
    np.testing.assert_allclose(found[:first], by_tracker(growing, trace.cut(None, float(first)), 1.0), rtol=1e-9)


def test_a_missing_column_is_named(trace_of):
    with pytest.raises(Refused, match="no column 'flash_degC'"):
        estimate_degC(SYSTEM, "first-order", ("flash_degC", "usb_degC"), trace_of(10))
