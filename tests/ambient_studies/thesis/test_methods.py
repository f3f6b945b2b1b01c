"""Every model in every variant: what it computes, that it cannot see the reference, and that it finds itself again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ambient_model.faults import Refused
from ambient_studies.thesis.methods import MODELS, NONCAUSAL, fit_model, fitted_method, published_method, thesis_methods
from ambient_studies.thesis.parameters import published_parameters
from ambient_studies.thesis.printed import PRINTED
from ambient_trainer.circuits.schema import load_circuit
from ambient_trainer.estimators.fit import Effort, fit_circuit
from ambient_trainer.estimators.model_file import model_of
from ambient_trainer.evaluation.evaluate import evaluate_trace


@pytest.fixture(scope="session")
def methods(training):
    return {(each.name, each.variant): each for each in thesis_methods(training)}


def test_all_ten_models_in_every_variant_that_applies(methods):
    assert set(methods) == {
        *((model, "corrected") for model in MODELS),
        *((model, "published_parameters") for model in MODELS),
        *((model, "as_printed") for model in PRINTED),
        (NONCAUSAL, "noncausal"),
    }
    assert len(MODELS) == 10
    assert all(each.about for each in methods.values())


def test_every_estimate_is_finite(methods, unseen):
    for each in methods.values():
        found = each.estimate(unseen)
        assert found.shape == unseen.time_s.shape
        assert np.isfinite(found).all(), (each.name, each.variant)


def test_no_method_but_the_noncausal_sees_the_reference(methods, training, unseen):
    """Not even for its initial state: whatever stands in the reference, the estimate is the same to the bit."""
    random = np.random.default_rng(0)
    noise = random.normal(0, 100, len(unseen.time_s))
    gone = np.full(len(unseen.time_s), np.nan)
    for key, each in methods.items():
        if each.variant == "noncausal":
            continue
        wanted = each.estimate(unseen)
        for corrupt in (noise, gone):
            other = replace(unseen, columns={**unseen.columns, "ambient_degC": corrupt})
            assert np.array_equal(each.estimate(other), wanted), key
        absent = {name: values for name, values in unseen.columns.items() if name != "ambient_degC"}
        assert np.array_equal(each.estimate(replace(unseen, columns=absent)), wanted), key


def test_no_estimate_looks_ahead(methods, unseen):
    half = len(unseen.time_s) // 2
    first = unseen.cut(None, float(unseen.time_s[half]))
    for key, each in methods.items():
        if each.variant != "noncausal":
            np.testing.assert_allclose(
                each.estimate(first), each.estimate(unseen)[:half], rtol=0, atol=1e-9, err_msg=key
            )


def test_the_noncausal_is_the_fitted_one_moved_to_no_mean_error(methods, unseen):
    causal, noncausal = (
        methods[NONCAUSAL, "corrected"].estimate(unseen),
        methods[NONCAUSAL, "noncausal"].estimate(unseen),
    )
    offset = noncausal - causal
    np.testing.assert_allclose(offset, offset[0], atol=1e-9)
    assert abs(offset[0]) > 0.1
    assert np.mean(unseen.reference - noncausal) == pytest.approx(0, abs=1e-9)
    # samples without a reference do not count
    partly = np.where(np.arange(len(unseen.time_s)) % 3 == 0, np.nan, unseen.reference)
    other = replace(unseen, columns={**unseen.columns, "ambient_degC": partly})
    assert np.nanmean(partly - methods[NONCAUSAL, "noncausal"].estimate(other)) == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize("model", MODELS)
def test_an_estimate_is_what_the_device_says(training, unseen, model):
    """The exported model file, run by the device's own tracker."""
    fit = fit_model(model, training)
    device = evaluate_trace(model_of(fit, [], {}), unseen)
    assert device.period_s == 5.0
    # gains of millions that cancel, as free C and D may get, leave less than sixteen digits to either
    terms = np.abs(fit.system.C) @ np.abs(np.linalg.solve(fit.system.A, fit.system.B)) + np.abs(fit.system.D)
    tolerance = 1e-9 + 1e-13 * float(terms.sum())
    np.testing.assert_allclose(fitted_method(fit).estimate(unseen), device.estimate_degC, rtol=0, atol=tolerance)


@pytest.mark.parametrize("model", MODELS)
def test_a_models_own_output_fits_to_the_same_output(training, model):
    """The thesis's test of section 5.5, from several starts; parameters may differ, the output not."""
    own = fitted_method(fit_model(model, training)).estimate(training)
    told = replace(training, columns={**training.columns, "ambient_degC": own})
    again = fit_circuit(load_circuit(model), [told], Effort(starts=6))
    assert again.rmse_degC < 0.01
    np.testing.assert_allclose(fitted_method(again).estimate(training), own, atol=0.1)


def test_kirchhoff_is_equation_4_4(training, unseen):
    p = published_parameters()["model1_kirchhoff"].printed
    G = {name: 1 / p[f"R_{name}_ambient"] for name in ("flash", "battery", "usb")}
    heat = sum(G[name] * unseen.columns[f"{name}_degC"] for name in G) + p["q_e"]
    found = published_method("model1_kirchhoff").estimate(unseen)
    np.testing.assert_allclose(found, heat / sum(G.values()), rtol=1e-12)
    # so table 4.1 says that the ambient is the USB sensor's temperature plus q_e R_usb,amb
    np.testing.assert_allclose(found, unseen.columns["usb_degC"] + 0.01, atol=1e-4)


def test_published_model_2_by_a_loop_over_samples(unseen):
    """Table 4.6 with the corrected equations, integrated by small steps along the lines between the samples."""
    p = published_parameters()["model2_ss_free_cd"].printed
    names = ("flash", "battery", "usb", "display")
    u = np.array([unseen.columns[f"{name}_degC"] for name in names]).T[:200]

    def slope(x, flash, battery, usb, display):
        return np.array(
            [
                (-x[0] / p["R_flash_ambient"] + (display - flash) / p["R_display_flash"]) / p["C_flash"],
                (
                    -x[1] / p["R_battery_ambient"]
                    + (usb - battery) / p["R_battery_usb"]
                    + (display - battery) / p["R_display_battery"]
                )
                / p["C_battery"],
                (-x[2] / p["R_usb_ambient"] + (battery - usb) / p["R_battery_usb"]) / p["C_usb"],
            ]
        )

    x = np.zeros(3)
    for _ in range(200_00):
        x = x + 0.05 * slope(x, *u[0])
    said, steps = [], 500
    for here, there in zip(u, [*u[1:], u[-1]]):
        weights = [p[f"w{index}"] for index in range(1, 8)]
        said.append(float(np.dot(weights, [*x, *here])))
        h = 5.0 / steps
        for k in range(steps):
            x = x + h * slope(x, *(here + (there - here) * (k + 0.5) / steps))
    np.testing.assert_allclose(published_method("model2_ss_free_cd").estimate(unseen)[:200], said, atol=2e-3)


def test_progress_is_told_of_every_fit(training):
    told = []
    thesis_methods(training.cut(None, 3000), lambda *each: told.append(each))
    assert told == [(model, index, 10) for index, model in enumerate(MODELS)]


def test_a_trace_without_a_sensor_is_refused(methods, training, unseen):
    columns = {name: values for name, values in unseen.columns.items() if name != "usb_degC"}
    with pytest.raises(Refused, match="no column 'usb_degC'"):
        methods["linear_usb", "corrected"].estimate(replace(unseen, columns=columns))
    with pytest.raises(Refused, match="no column 'usb_degC'"):
        thesis_methods(replace(training, columns={**columns}, time_s=unseen.time_s))
