"""Published tables, printed matrices and errata against the text, the circuits and one another."""

import csv
import re
from importlib import resources

import numpy as np
import pytest
from scipy.stats import norm

from ambient_studies.thesis.errata import computed_errata, text_errata
from ambient_studies.thesis.methods import printed_models
from ambient_studies.thesis.published import published_parameters, published_results, sensor_statistics
from ambient_trainer.circuits.assemble import assemble
from ambient_trainer.circuits.schema import load_circuit

GREY_BOX = ("model1_ss", "model1_ss_single_input", "model2_ss", "model2_ss_single_input", "model2_ss_free_cd")
"""Tables 4.2 to 4.6, in order."""

NODES = {"soc": "soc", "disp": "display", "flash": "flash", "batt": "battery", "usb": "usb", "amb": "ambient"}
ROUNDING = 0.005 + 1e-9


def _name(printed):
    """``R _{batt,amb}`` is R_battery_ambient, ``<i>w</i> ₁`` is w1."""
    bare = re.sub(r"<[^>]*>|[^A-Za-z0-9]", "", printed.translate(str.maketrans("₁₂₃₄₅₆₇", "1234567")))
    if bare[0] in "wW":
        return bare.lower()
    return "_".join([bare[0], *(NODES[each] for each in re.findall("|".join(NODES), bare[1:]))])


def _number(printed):
    power = re.fullmatch(r"\$(.*) \\cdot 10\^\{?(\d)\}?\$", printed)
    return float(f"{power[1]}e{power[2]}") if power else float(printed)


def test_tables_4_2_to_4_6_are_the_texts_and_circuits_start_where_the_thesis_did(thesis_file):
    """Rows of the text: name, free, range, initial, estimated."""
    found = re.findall(r"^(.+)\t(yes|no)\t(.+)\t(.+)\t(.+)$", thesis_file("thesis.txt"), re.MULTILINE | re.IGNORECASE)
    rows = iter(found)
    for model, length in zip(GREY_BOX, (12, 9, 12, 9, 16)):
        table = {_name(row[0]): row[1:] for row in (next(rows) for _ in range(length))}
        estimated = {name: _number(row[-1]) for name, row in table.items()}
        assert dict(published_parameters()[model].printed) == estimated
        circuit = {each.name: each for each in load_circuit(model).parameters}
        assert set(circuit) == set(table)
        for name, (free, span, initial, _) in table.items():
            each = circuit[name]
            assert (each.initial, each.free) == (float(initial), free.lower() == "yes")
            if name.startswith("w") and "infty" not in span:
                assert (each.low, each.high) == (0, 1)
    assert next(rows, None) is None


def test_tables_4_1_4_7_and_4_8_are_the_texts(thesis_file):
    text, published = thesis_file("thesis.txt"), published_parameters()
    row = re.search(r"^Parameters\t(.+)\t(.+)\t(.+)$", text, re.MULTILINE).groups()
    kirchhoff = dict(zip(("R_battery_ambient", "R_usb_ambient", "R_flash_ambient"), map(_number, row)))
    assert dict(published["model1_kirchhoff"].printed) == {**kirchhoff, "q_e": 1.0}
    for sensor in ("Battery", "USB", "Flash"):
        k, m = re.search(rf"^{sensor} linear\t(.+)\t(.+)$", text, re.MULTILINE).groups()
        assert dict(published[f"linear_{sensor.lower()}"].printed) == {"k": float(k), "m": float(m)}
    combined = re.search(r"^Parameters\t(.+)\t(.+)\t(.+)\t(.+)$", text, re.MULTILINE).groups()
    assert list(published["linear_combined"].printed.values()) == list(map(float, combined))


@pytest.mark.parametrize("name", ["results.csv", "sensor_statistics.csv", "display_mean.csv"])
def test_the_shipped_tables_are_the_originals(thesis_file, name):
    shipped = (resources.files("ambient_studies.thesis") / name).read_text()
    assert list(csv.reader(shipped.splitlines())) == list(csv.reader(thesis_file(name).splitlines()))


def test_intervals_are_mean_and_quantile_times_sigma_of_the_same_row():
    """sigma from the 98 % interval (the widest rounds least) must give the other intervals, and the row's RMSE."""
    for key, each in published_results().items():
        low, high = each.interval_degC[98]
        sigma = (high - low) / (2 * norm.ppf(0.99))
        for level, band in each.interval_degC.items():
            reach = norm.ppf(0.5 + level / 200) * sigma
            # both ends and the mean are rounded, and so is sigma
            expected = (each.mbe_degC - reach, each.mbe_degC + reach)
            np.testing.assert_allclose(band, expected, atol=4 * ROUNDING, err_msg=str(key))
        # sigma is over N - 1, RMSE over N
        assert np.hypot(each.mbe_degC, sigma) == pytest.approx(each.rmse_degC, rel=1.5e-3, abs=2 * ROUNDING), key
        assert abs(each.mbe_degC) - 2 * ROUNDING <= each.mae_degC <= each.rmse_degC + ROUNDING, key


def test_a_sensors_statistics_follow_from_its_linear_models_errors():
    """With T_hat = k T + m and truth 20: mean(T) = (20 - MBE - m)/k, std(T) = sqrt(RMSE^2 - MBE^2)/k."""
    known = {key: each for key, each in sensor_statistics().items() if key[1] != "display"}
    assert set(known) == {(s, name) for s in ("1", "2.1", "2.3", "2.4") for name in ("battery", "usb", "flash")}
    for (scenario, sensor), found in known.items():
        line = published_parameters()[f"linear_{sensor}"].printed
        errors = published_results()[scenario, f"linear_{sensor}"]
        assert found.mean_degC == pytest.approx((20 - errors.mbe_degC - line["m"]) / line["k"], abs=0.02)
        deviation = np.sqrt(errors.rmse_degC**2 - errors.mbe_degC**2) / line["k"]
        # the difference of two rounded squares
        assert found.std_degC == pytest.approx(deviation, rel=0.01, abs=0.02 / max(deviation, 0.1))
    assert sensor_statistics()["2.3", "display"].mean_degC == 25.57
    assert sensor_statistics()["2.3", "display"].std_degC is None


def _printed(model):
    return printed_models()[model].system


@pytest.mark.parametrize("model", ["model1_ss", "model2_ss", "model2_ss_free_cd"])
def test_only_row_2_of_b_differs_and_by_the_sign_of_the_exchange(model):
    p = published_parameters()[model].printed
    printed, corrected = _printed(model), assemble(load_circuit(model), p).value
    assert printed_models()[model].inputs == load_circuit(model).inputs
    np.testing.assert_allclose(printed.A, corrected.A, rtol=1e-14)
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


@pytest.mark.parametrize(
    ("number", "first", "written"),
    [
        pytest.param(1, 1, "310 -319", id="1: the gains of table 4.6 as printed"),
        pytest.param(1, 4, "0.970 -0.42 -1.47 -8.48 11.34 0.970", id="1: and under the other sign"),
        pytest.param(1, 11, "20.8 23.6 25.6 23.9", id="1: the display's means that those imply"),
        pytest.param(2, 0, "-0.017 0.21 -0.0661 -5.26 -6.77", id="2: complex poles against real ones"),
        pytest.param(5, 0, "-12.2 0.5 0.1", id="5: the order of table 4.8 on the recovered means"),
        pytest.param(6, 0, "0.42 1.36 29 0.042 0.982", id="6: the weights of table 4.4"),
        pytest.param(7, 0, "0.0 16.07", id="7: by the printed objective the worst model is perfect"),
        pytest.param(9, 0, "6 6 54 0", id="9: only the single-input model is symmetric"),
        pytest.param(10, 2, "-0.70", id="10: a gain of the single-input models"),
        pytest.param(11, 0, "0.90 0.92 6", id="11: two figures for one error"),
    ],
)
def test_the_figures_are_as_they_are_written(number, first, written):
    texts = written.split()
    decimals = [len(text.partition(".")[2]) for text in texts]
    [figures] = [each.figures for each in text_errata() if each.number == number]
    values = [figure.value for figure in figures[first : first + len(texts)]]
    assert [round(value, digits) for value, digits in zip(values, decimals)] == list(map(float, texts))


@pytest.mark.slow
def test_8_the_missing_term_measured(runs):
    found = {each.number: each for each in computed_errata(runs.training, runs.evaluated["3"])}
    assert list(found) == [1, 2, 3, 5, 6, 7, 8, 9, 10, 11]
    without, with_term, without_trained, with_trained = [figure.value for figure in found[8].figures]
    # this air moves, and the simulated phone stores C dT/dt
    assert with_term < without
    assert with_trained < without_trained
