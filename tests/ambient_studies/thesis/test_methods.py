"""The thesis's models: a fit recovers their outputs, and what a moving ambient adds to them."""

from dataclasses import replace

import numpy as np
import pytest

from ambient_studies.thesis.methods import fit_model
from ambient_studies.thesis.moving_ambient import INPUTS, fit_with_moving_ambient, with_moving_ambient
from ambient_studies.thesis.published import MODELS
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
    own = fit_model(model, training).estimate_degC(training)
    synthetic = replace(training, columns={**training.columns, "ambient_degC": own})
    again = estimator(model).fit([synthetic], Effort(starts=3))
    assert again.rmse_degC < 0.01
    np.testing.assert_allclose(again.estimate_degC(training), own, atol=0.1)


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
