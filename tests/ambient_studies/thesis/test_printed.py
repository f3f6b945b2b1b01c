"""The printed matrices are the text's, errors included; without the errors they are the circuits'."""

import numpy as np
import pytest

from ambient_studies.thesis.printed import PRINTED
from ambient_studies.thesis.published import published_parameters
from ambient_trainer.circuits.assemble import assemble
from ambient_trainer.circuits.schema import load_circuit


def _printed(model):
    return PRINTED[model].system(published_parameters()[model].printed)


def _corrected(model):
    return assemble(load_circuit(model), published_parameters()[model].printed).value


@pytest.mark.parametrize("model", ["model1_ss", "model2_ss", "model2_ss_free_cd"])
def test_only_row_2_of_b_differs_and_by_the_sign_of_the_exchange(model):
    printed, corrected = _printed(model), _corrected(model)
    assert PRINTED[model].inputs == load_circuit(model).inputs
    for each in ("A", "C", "D", "offset"):
        np.testing.assert_allclose(getattr(printed, each), getattr(corrected, each), rtol=1e-14)
    p = published_parameters()[model].printed
    exchange = 1 / (p["R_battery_usb"] * p["C_battery"])
    np.testing.assert_allclose(
        printed.B - corrected.B, [[0] * 4, [0, 2 * exchange, -2 * exchange, 0], [0] * 4], rtol=1e-12, atol=1e-12
    )


def test_the_printed_equations_with_their_tables_by_hand():
    """Rows of equations 4.9, 4.14, 4.25 and 4.27 with tables 4.2, 4.3 and 4.5."""
    # 1/0.47 (1/1.60 - 1/0.53), -1/(1.60 0.47), 1/(0.53 0.47)
    np.testing.assert_allclose(_printed("model1_ss").B[1], [0, -2.684666, -1.329787, 4.014452], rtol=1e-6)
    A22, exchange, usb = (-1 / 2.59 + 1 / 5176) / 199.9, -1 / (5176 * 199.9), 1 / (5176 * 5172)
    first = _printed("model1_ss_single_input")
    np.testing.assert_allclose(first.A, [[-1 / 1.1e4, 0, 0], [0, A22, exchange], [0, usb, -usb]], rtol=1e-14)
    np.testing.assert_allclose(first.B, [[1 / 1.1e4], [1 / (2.59 * 199.9)], [0]], rtol=1e-14)
    # 1/0.13 (1/2.26 - 1/2.33), -1/2.26 without C_batt; 1/(2.26 3.26)
    second = _printed("model2_ss_single_input")
    np.testing.assert_allclose(second.A[1:, 1:], [[0.102256, -0.442478], [0.135729, -0.135729]], rtol=1e-5)
    # G_f, G_u, G_b = 0.452489, 0.952381, 10 of 11.404869
    np.testing.assert_allclose(second.C, [[0.039675, 0.083507, 0.876818]], rtol=1e-5)


def test_equation_4_34_gives_the_coefficients_to_usb_battery_and_flash():
    assert PRINTED["linear_combined"].inputs == ("usb_degC", "battery_degC", "flash_degC")
    assert load_circuit("linear_combined").inputs == ("battery_degC", "usb_degC", "flash_degC")
    np.testing.assert_array_equal(_printed("linear_combined").D, _corrected("linear_combined").D)
    np.testing.assert_array_equal(_printed("linear_combined").offset, [-0.38])
