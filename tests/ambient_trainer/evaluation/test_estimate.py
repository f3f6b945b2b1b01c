"""Estimates over whole arrays, over holes and gaps, and of a system that is unstable."""

from dataclasses import replace

import numpy as np
import pytest

from ambient_model.faults import Refused
from ambient_trainer.estimators.estimate import estimate_degC
from ambient_trainer.lti.statespace import StateSpace

INPUTS = ("usb_degC", "battery_degC")
SYSTEM = StateSpace(
    A=np.array([[-0.02, 0.01], [0.001, -0.003]]),
    B=np.array([[0.01, 0.0], [0.0, 0.002]]),
    C=np.array([[-0.4, 0.9]]),
    D=np.array([[0.3, 0.2]]),
    offset=np.array([-1.5]),
)


@pytest.mark.parametrize("period_s", [0.1, 1.0, 10.0])
def test_missing_values_and_gaps_leave_what_came_before_and_are_bridged(trace_of, period_s):
    """By the device's own tracker; without them it is the array's recursion, which the parity tests hold against it."""
    whole = trace_of(600, period_s=period_s)
    usb = whole.columns["usb_degC"].copy()
    usb[[50, 51, 200]] = np.nan
    usb[300:360] = np.nan
    holes = replace(whole, columns={**whole.columns, "usb_degC": usb})
    kept = np.delete(np.arange(600), [100, 101, *range(400, 480)])
    gaps = replace(holes, time_s=holes.time_s[kept], columns={k: v[kept] for k, v in holes.columns.items()})
    expected = estimate_degC(SYSTEM, "first-order", INPUTS, whole)
    for each in (holes, gaps):
        found = estimate_degC(SYSTEM, "first-order", INPUTS, each)
        np.testing.assert_allclose(found[:50], expected[:50], rtol=0, atol=1e-9)
        assert np.isfinite(found[50:100]).all()
        assert np.abs(found[52:100] - expected[52:100]).max() < 1.0
    usb[0] = np.nan
    assert np.isnan(estimate_degC(SYSTEM, "first-order", INPUTS, holes)[0])


def test_an_unstable_system_ends_in_no_estimate(trace_of):
    """One mode grows by e in two seconds; a decoupled one and the samples before it diverges are untouched."""
    growing = replace(SYSTEM, A=np.diag([0.5, -0.01]), C=np.array([[1.0, 0.5]]))
    found = estimate_degC(growing, "first-order", INPUTS, trace_of(4000))
    first = int(np.argmin(np.isfinite(found)))
    assert 20 < first < 100
    assert np.isnan(found[first:]).all()


def test_a_missing_column_is_named(trace_of):
    with pytest.raises(Refused, match="no column 'flash_degC'"):
        estimate_degC(SYSTEM, "first-order", ("flash_degC", "usb_degC"), trace_of(10))
