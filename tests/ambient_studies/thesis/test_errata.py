"""Each erratum's figures are those of the list of errata, computed from the tables."""

from __future__ import annotations

import pytest

from ambient_studies.thesis.errata import computed_errata, implied_display_degC, text_errata
from ambient_studies.thesis.published import sensor_statistics


@pytest.fixture(scope="module")
def figures():
    """By number, then by label, the value; labels are unique within an erratum."""
    found = {}
    for each in text_errata():
        found[each.number] = [figure.value for figure in each.figures]
        assert all(type(value) in (int, float) for value in found[each.number])
        assert {figure.unit for figure in each.figures} <= {"", "degC", "1/s", "rad/s"}
        assert each.title
        assert each.statement.endswith(".")
    return found


def test_each_has_its_number(figures):
    assert list(figures) == [1, 2, 3, 5, 6, 7, 9, 10, 11]


def test_1_the_gains_of_table_4_6_under_both_signs(figures):
    printed, corrected = figures[1][:5], figures[1][5:10]
    assert [round(value) for value in printed[1:3]] == [310, -319]
    assert [round(value, 2) for value in corrected[:4]] == [-0.42, -1.47, -8.48, 11.34]
    assert round(corrected[4], 3) == round(printed[4], 3) == 0.970
    assert abs(figures[1][10] - 20) > 100
    assert [round(value, 1) for value in figures[1][11:]] == [20.8, 23.6, 25.6, 23.9]


def test_1_the_implied_display_means_are_those_of_the_data_file():
    gains = dict(zip(("flash", "battery", "usb", "display"), (-0.421807, -1.472494, -8.475263, 11.339564)))
    for scenario in ("1", "2.1", "2.3", "2.4"):
        found = implied_display_degC(gains, scenario)
        assert found == pytest.approx(sensor_statistics()[scenario, "display"].mean_degC, abs=0.006)


def test_2_complex_poles_against_real_ones(figures):
    assert round(figures[2][0], 3) == -0.017
    assert round(figures[2][1], 2) == 0.21
    assert [float(f"{value:.2e}") for value in figures[2][2:5]] == [-0.0661, -5.26, -6.77]
    assert figures[2][5] == 0


def test_3_the_order_swaps_battery_and_usb(figures):
    flash, battery, usb = figures[3][:3]
    assert figures[3][3:] == [flash, usb, battery]
    assert sum(figures[3][:3]) == pytest.approx(1)


def test_5_the_order_of_table_4_8_on_the_recovered_means(figures):
    assert [round(value, 1) for value in figures[5]] == [-12.2, 0.5, 0.1]


def test_6_the_weights_of_table_4_4(figures):
    w1, weights, idle = figures[6][:3]
    assert (w1, round(weights, 2), round(idle)) == (0.42, 1.36, 29)
    w1, weights, idle = figures[6][3:6]
    assert (w1, round(weights, 3)) == (0.042, 0.982)
    assert abs(idle - 20) < 0.5
    assert figures[6][6] == 0.2


def test_7_by_the_printed_objective_the_worst_model_is_perfect(figures):
    assert figures[7] == [0.0, 16.07]


def test_9_only_the_single_input_model_is_symmetric(figures):
    assert figures[9] == [6, 6, 54, 0]


def test_10_the_single_input_at_rest(figures):
    gain, implied, published = figures[10]
    assert gain == pytest.approx(1)
    assert implied == pytest.approx(20 - sensor_statistics()["1", "display"].mean_degC)
    assert published == -0.70


def test_11_two_figures_for_one_error(figures):
    assert figures[11] == [0.90, 0.92, 6]


@pytest.mark.slow
def test_8_the_missing_term_measured(runs):
    found = {each.number: each for each in computed_errata(runs.training, runs.evaluated["3"])}
    assert list(found) == [1, 2, 3, 5, 6, 7, 8, 9, 10, 11]
    without, with_term, without_trained, with_trained = [figure.value for figure in found[8].figures]
    # this air moves, and the simulated phone stores C dT/dt
    assert with_term < without
    assert with_trained < without_trained
