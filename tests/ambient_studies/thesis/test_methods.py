"""The thesis's models: what they compute, that a device computes the same, and that a fit recovers them."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lsim

from ambient_model.faults import Refused
from ambient_studies.thesis.methods import fit_model, fitted_method, published_method, thesis_methods
from ambient_studies.thesis.moving_ambient import INPUTS, fit_with_moving_ambient, with_moving_ambient
from ambient_studies.thesis.published import MODELS, published_parameters
from ambient_trainer.estimators.base import Effort
from ambient_trainer.estimators.estimate import estimate_degC
from ambient_trainer.estimators.registry import estimator
from ambient_trainer.lti.statespace import StateSpace

from .conftest import wandering


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


RISES = StateSpace(
    A=np.diag([-0.03, -0.008, -0.003]),
    B=np.array([[-0.02, 0, 0, 0.02], [0, -0.009, 0.005, 0.004], [0, 0.003, -0.003, 0]]),
    C=np.array([[0.3, 0.2, -0.7]]),
    D=np.array([[0.1, -0.1, 0.6, 0.4]]),
    offset=np.zeros(1),
)


@pytest.mark.parametrize("frequency", [1e-5, 1e-3, 0.01, 0.3, 10.0])
def test_every_frequency_obeys_the_implicit_balance(frequency):
    """s x = A x + B u - 1 s y with y = C x + D u, solved for x and y together at s = i omega."""
    s, u = 2j * np.pi * frequency, np.array([1.0, 0.3 - 0.2j, -0.5j, 2.0])
    implicit = np.zeros((4, 4), dtype=complex)
    implicit[:3, :3], implicit[:3, 3] = s * np.eye(3) - RISES.A, s
    implicit[3, :3], implicit[3, 3] = -RISES.C[0], 1
    y = np.linalg.solve(implicit, [*(RISES.B @ u), (RISES.D @ u)[0]])[3]
    found = with_moving_ambient(RISES)
    explicit = found.C @ np.linalg.solve(s * np.eye(3) - found.A, found.B @ u) + found.D @ u
    np.testing.assert_allclose(explicit[0], y, rtol=1e-9)


def test_a_fit_recovers_a_circuit_that_has_the_term():
    """Without the term no fit could follow its output; missing samples are left out."""
    truth = with_moving_ambient(RISES)

    def observed(trace):
        estimate = estimate_degC(truth, "first-order", INPUTS, trace)
        return replace(trace, columns={**trace.columns, "ambient_degC": estimate})

    training, unseen = observed(wandering(1500, 1, 10.0)), observed(wandering(1000, 2, 10.0))
    reference = training.reference.copy()
    reference[100:400] = np.nan
    found = fit_with_moving_ambient(replace(training, columns={**training.columns, "ambient_degC": reference}))
    error = unseen.reference - estimate_degC(found, "first-order", INPUTS, unseen)
    assert np.sqrt(np.mean(error**2)) < 1e-6
