"""The thesis's models: what they compute, that a device computes the same, and that a fit recovers them."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lsim

from ambient_model.faults import Refused
from ambient_studies.thesis.methods import fit_model, fitted_method, published_method, thesis_methods
from ambient_studies.thesis.published import MODELS, published_parameters
from ambient_trainer.estimators.base import Effort
from ambient_trainer.estimators.model_file import model_of
from ambient_trainer.estimators.registry import estimator
from ambient_trainer.evaluation.evaluate import evaluate_trace


@pytest.mark.parametrize("model", ["model1_ss_single_input", "model2_ss", "model2_ss_free_cd", "linear_combined"])
def test_an_estimate_is_the_devices_own(runs, model):
    """The exported model file, run by the device's tracker."""
    fit, unseen = fit_model(model, runs.training), runs.evaluated["3"]
    device = evaluate_trace(model_of(fit, [], {}), unseen)
    # gains of millions that cancel, as free C and D may get, leave less than sixteen digits to either
    terms = np.abs(fit.system.C) @ np.abs(np.linalg.solve(fit.system.A, fit.system.B)) + np.abs(fit.system.D)
    tolerance = 1e-9 + 1e-13 * float(terms.sum())
    np.testing.assert_allclose(fitted_method(fit).estimate(unseen), device.estimate_degC, rtol=0, atol=tolerance)


@pytest.mark.slow
@pytest.mark.parametrize("model", MODELS)
def test_a_fit_recovers_the_output_of_the_same_model(runs, model):
    """The thesis's test of section 5.5, from several starts; parameters may differ, the output not."""
    training = runs.training
    own = fitted_method(fit_model(model, training)).estimate(training)
    synthetic = replace(training, columns={**training.columns, "ambient_degC": own})
    again = estimator(model).fit([synthetic], Effort(starts=3))
    assert again.rmse_degC < 0.01
    np.testing.assert_allclose(fitted_method(again).estimate(training), own, atol=0.1)


def test_published_model_2_by_another_simulation(runs):
    """Table 4.6 with the corrected equations, by scipy's simulation along the lines between the samples."""
    p = published_parameters()["model2_ss_free_cd"].printed
    unseen, names = runs.evaluated["3"], ("flash", "battery", "usb", "display")
    u = np.array([unseen.columns[f"{name}_degC"] for name in names]).T
    Gf, Gb, Gu = (1 / p[f"R_{name}_ambient"] for name in names[:3])
    Gdf, Gdb, Gbu = 1 / p["R_display_flash"], 1 / p["R_display_battery"], 1 / p["R_battery_usb"]
    C = np.array([p["C_flash"], p["C_battery"], p["C_usb"]])[:, None]
    A = -np.diag([Gf, Gb, Gu]) / C
    B = np.array([[-Gdf, 0, 0, Gdf], [0, -Gbu - Gdb, Gbu, Gdb], [0, Gbu, -Gbu, 0]]) / C
    w = [p[f"w{index}"] for index in range(1, 8)]
    _, expected, _ = lsim((A, B, [w[:3]], [w[3:]]), u, unseen.time_s, X0=np.linalg.solve(-A, B @ u[0]))
    np.testing.assert_allclose(published_method("model2_ss_free_cd").estimate(unseen), expected, atol=1e-6)


def test_a_trace_without_a_sensor_is_refused(runs):
    training = runs.training
    columns = {name: values for name, values in training.columns.items() if name != "usb_degC"}
    for work in (published_method("linear_usb").estimate, lambda trace: thesis_methods(trace, lambda *_: None)):
        with pytest.raises(Refused, match="no column 'usb_degC'"):
            work(replace(training, columns=columns))
