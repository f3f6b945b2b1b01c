"""Offsets from the record of a bath, against what was put into it."""

import numpy as np
import pandas as pd
import pytest
from scipy.signal import lfilter

from ambient_trainer.evaluation.bath import Settled, calibrated, unsettled
from refusals import refused

PERIOD_S = 2.0


def bath(reference_degC, offsets_K, noise_K=0.02, seed=0) -> pd.DataFrame:
    """The readings of probes that lack these offsets in a bath of this temperature, once in two seconds."""
    random = np.random.default_rng(seed)
    reference_degC = np.asarray(reference_degC, dtype=float)
    count = len(reference_degC)
    probes = {
        name: reference_degC - offset_K + noise_K * random.standard_normal(count)
        for name, offset_K in offsets_K.items()
    }
    return pd.DataFrame({"bath": reference_degC, **probes}, index=PERIOD_S * np.arange(count))


def test_an_offset_is_the_mean_difference_with_its_error_and_a_probe_elsewhere_is_refused():
    window = bath(np.full(151, 20.0), {"a": 0.3, "b": -1.0})
    offsets = calibrated([window], "bath")
    (point,) = offsets["a"].points
    assert point.offset_K == pytest.approx((20.0 - window["a"]).mean())
    assert point.reading_degC == pytest.approx(window["a"].mean())
    assert point.standard_error_K == pytest.approx(0.02 / np.sqrt(151), rel=0.5)
    assert offsets["b"].points[0].offset_K == pytest.approx(-1.0, abs=0.01)
    (fault,) = refused(calibrated, [bath(np.full(151, 0.0), {"a": 0.3, "b": -21.0}, noise_K=0.0)], "the bath").faults
    assert (fault.place, "21.00 degC" in fault.problem, "0.00 degC" in fault.problem) == ("b", True, True)


@pytest.mark.parametrize("kept", [0.0, 0.8])
def test_standard_errors_hold_for_autocorrelated_noise(kept):
    inside = 0
    for seed in range(200):
        white = np.random.default_rng(seed).standard_normal(451)
        noise = lfilter([0.02 * np.sqrt(1 - kept**2)], [1.0, -kept], white)[150:]
        window = pd.DataFrame({"bath": 20.0, "a": 20.0 - 0.1 + noise}, index=PERIOD_S * np.arange(301))
        (point,) = calibrated([window], "bath")["a"].points
        inside += abs(point.offset_K - 0.1) < 1.96 * point.standard_error_K
    assert 0.86 <= inside / 200 <= 0.99  # of 0.95; the estimated autocorrelation time is a little short


@pytest.mark.parametrize(
    ("spoil", "reasons"),
    [
        (lambda window: window[:100], ["it lasts 198 s of 300 s"]),
        (lambda window: window[:0], ["it lasts 0 s of 300 s"]),
        (lambda window: window.assign(b=window["b"] + 0.001 * window.index), ["b drifts by 0.30 K"]),
        (lambda window: window.assign(b=window["b"].where(window.index >= 100)), ["b has 101 readings where 121"]),
        (lambda window: window[["bath"]] * np.nan, ["the reference has 0 readings where 121"]),
        (lambda window: window, []),
    ],
)
def test_what_is_not_settled_has_a_reason(spoil, reasons):
    found = unsettled(spoil(bath(np.full(151, 20.0), {"a": 0.3, "b": 0.0}, noise_K=0.001)), Settled())
    assert len(found) == len(reasons)
    assert all(each.startswith(reason) for each, reason in zip(found, reasons))
