"""No method uses the reference of the run under evaluation, nor any later sample; only the non-causal variant may."""

from dataclasses import replace

import numpy as np
import pytest

from ambient_studies.thesis.published import NONCAUSAL

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def causal(methods):
    return {key: each for key, each in methods.items() if each.variant != "noncausal"}


def corruptions(trace):
    """The trace with another first reference, the reference moved, made noise, missing and absent."""
    reference = trace.reference
    noise = np.random.default_rng(0).normal(0.0, 300.0, len(reference))
    changed = {
        "first sample": np.append(reference[0] + 40.0, reference[1:]),
        "moved": reference - 5.0,
        "noise": noise,
        "missing": np.full(len(reference), np.nan),
    }
    found = {name: replace(trace, columns={**trace.columns, "ambient_degC": each}) for name, each in changed.items()}
    sensors = {name: values for name, values in trace.columns.items() if name != "ambient_degC"}
    return {**found, "absent": replace(trace, columns=sensors)}


def test_a_corrupted_reference_changes_no_bit_of_a_causal_estimate(causal, runs):
    for trace in runs.evaluated.values():
        changed = corruptions(trace)
        for key, method in causal.items():
            estimate = method.estimate(trace)
            assert estimate.shape == trace.time_s.shape
            if method.variant != "as_printed":
                assert np.isfinite(estimate).all(), (trace.path, key)
            for name, other in changed.items():
                assert method.estimate(other).tobytes() == estimate.tobytes(), (trace.path, key, name)


def test_a_causal_estimate_knows_no_later_sample(causal, runs):
    for trace in runs.evaluated.values():
        half = len(trace.time_s) // 2
        early = trace.cut(None, float(trace.time_s[half]))
        for key, method in causal.items():
            whole = method.estimate(trace)[:half]
            np.testing.assert_allclose(method.estimate(early), whole, rtol=1e-9, atol=1e-9, err_msg=str(key))


def test_the_noncausal_one_is_the_fitted_one_without_its_mean_error(methods, runs):
    peeking, fitted = methods[NONCAUSAL, "noncausal"], methods[NONCAUSAL, "corrected"]
    trace = runs.evaluated["3"]
    # samples without a reference do not count
    partly = np.where(np.arange(len(trace.time_s)) % 3 == 0, np.nan, trace.reference)
    for other in (trace, replace(trace, columns={**trace.columns, "ambient_degC": partly})):
        offset = peeking.estimate(other) - fitted.estimate(other)
        assert np.ptp(offset) < 1e-9
        assert abs(offset[0]) > 0.1
        assert np.nanmean(other.reference - peeking.estimate(other)) == pytest.approx(0, abs=1e-9)
