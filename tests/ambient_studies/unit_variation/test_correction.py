"""A correction against errors that are known by construction, in the file and through the daemon's own recursion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ambient_model.codec import decode, encode
from ambient_model.conformance import worst_difference_degC
from ambient_model.faults import Refused
from ambient_trainer.evaluation.correction import corrected, correction, known_between
from ambient_trainer.evaluation.evaluate import evaluate_trace

SOURCE = {"trace": "known.csv", "sha256": "0" * 64, "from_s": None, "to_s": None}


def test_each_estimator_is_corrected_by_its_own_mean_error(mean, known):
    model, trace = mean(), known()
    found = correction(model, trace)
    usb, display = (trace.columns[name].mean() for name in ("usb_degC", "display_degC"))
    expected = {
        "main": 21.0 - (0.5 * usb + 0.5 * display + 1.0),
        "without usb": 21.0 - (display - 2.0),
        "guard": 21.0 - (0.75 * usb + 0.25 * display + 0.5),
    }
    assert found.offsets_degC == pytest.approx(expected, abs=1e-9)
    assert found.samples == 400
    # white noise of 0.1 in each sensor
    assert found.standard_error_degC == pytest.approx(0.1 * np.sqrt(0.5) / np.sqrt(400), rel=0.5)


def test_the_corrected_file_is_right_on_average_and_otherwise_the_same(mean, known):
    model, trace = mean(), known()
    result = corrected(model, correction(model, trace), SOURCE)
    assert evaluate_trace(result, trace).metrics.mbe_degC == pytest.approx(0.0, abs=1e-9)
    before, after = evaluate_trace(model, known(seed=5)), evaluate_trace(result, known(seed=5))
    assert before.metrics.mbe_degC == pytest.approx(-4.0, abs=0.02)
    assert abs(after.metrics.mbe_degC) < 0.02
    assert after.metrics.sigma_degC == pytest.approx(before.metrics.sigma_degC, rel=1e-9)
    assert result.main.discrete == model.main.discrete
    assert result.main.interval == model.main.interval
    assert result.secondary.threshold_degC == model.secondary.threshold_degC
    alone = result._replace(main=result.fallbacks["usb"], fallbacks={}, secondary=None)
    assert evaluate_trace(alone, trace).metrics.mbe_degC == pytest.approx(0.0, abs=1e-9)


def test_the_file_stands_by_itself(mean, known):
    """It decodes, its test vector is its own, and it says where the correction is from; twice is said twice."""
    model = mean(guarded=False)
    once = corrected(model, correction(model, known()), SOURCE)
    twice = corrected(once, correction(once, known(seed=1)), SOURCE)
    assert decode(encode(twice).encode(), "twice") == twice
    assert worst_difference_degC(twice) == 0.0
    assert twice.secondary is None
    said = twice.provenance["corrections"]
    assert [each["trace"] for each in said] == ["known.csv", "known.csv"]
    assert model.main.offset + sum(each["offsets_degC"]["main"] for each in said) == pytest.approx(twice.main.offset)
    assert abs(said[1]["offsets_degC"]["main"]) < 0.05
    assert twice.provenance["circuit"] == "mean"
    assert "corrections" not in model.provenance


def test_only_what_is_known_counts_but_the_estimate_runs_from_the_start(free_model, known):
    """A filter's error after it has settled, not that of its start."""
    trace = known(samples=3000)
    others = dict.fromkeys(("soc_degC", "flash_degC", "battery_degC"), trace.columns["usb_degC"])
    jump = np.where(trace.time_s < 1000, 15.0, 0.0)
    columns = {name: values + jump for name, values in {**trace.columns, **others}.items() if name != "ambient_degC"}
    trace = replace(trace, time_s=trace.time_s * 5, columns={**columns, "ambient_degC": trace.reference})
    known_late = known_between(trace, 10_000.0, 14_000.0)
    assert np.isfinite(known_late.reference).sum() == 800
    whole = evaluate_trace(free_model, trace).error_degC
    assert correction(free_model, known_late).offsets_degC["main"] == pytest.approx(whole[2000:2800].mean(), abs=1e-9)


def test_no_known_ambient_is_refused(mean, known):
    with pytest.raises(Refused, match="too few samples to score"):
        correction(mean(), known_between(known(), 1e6, None))
