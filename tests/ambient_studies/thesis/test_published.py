"""The published tables are the text's, agree with themselves, and tell of the sensors what the data files hold."""

import csv
import re
from importlib import resources

import numpy as np
import pytest
from scipy.stats import norm

from ambient_studies.thesis.published import MODELS, published_parameters, published_results, sensor_statistics
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


def test_every_model_has_its_circuits_parameters_and_only_w1_of_table_4_4_is_corrected():
    found = published_parameters()
    tables = ("4.1", "4.2", "4.3", "4.4", "4.5", "4.6", "4.7", "4.7", "4.7", "4.8")
    assert {name: each.table for name, each in found.items()} == dict(zip(MODELS, tables))
    for model, each in found.items():
        assert set(each.printed) == {parameter.name for parameter in load_circuit(model).parameters}
        changed = {"w1": 0.042} if model == "model2_ss" else {}
        assert each.corrected == {**each.printed, **changed}
    assert found["model2_ss"].printed["w1"] == 0.42


@pytest.mark.parametrize("name", ["results.csv", "sensor_statistics.csv", "display_mean.csv"])
def test_the_shipped_tables_are_the_originals(thesis_file, name):
    shipped = (resources.files("ambient_studies.thesis") / name).read_text()
    assert list(csv.reader(shipped.splitlines())) == list(csv.reader(thesis_file(name).splitlines()))


def test_ten_models_in_six_scenarios():
    assert set(published_results()) == {(s, m) for s in ("1", "2.1", "2.3", "2.4", "3", "4") for m in MODELS}
    verification = published_results()["4", "model2_ss_free_cd"]
    assert (verification.rmse_degC, verification.mae_degC, verification.mbe_degC) == (1.30, 0.92, 0.11)
    assert verification.interval_degC == {50: (-0.76, 0.99), 90: (-2.02, 2.25), 98: (-2.90, 3.13)}


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
