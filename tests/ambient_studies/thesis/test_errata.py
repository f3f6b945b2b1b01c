"""Each erratum's figures are those of the list of errata, computed from the tables."""

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


@pytest.mark.parametrize(
    ("number", "first", "written"),
    [
        pytest.param(1, 1, "310 -319", id="1: the gains of table 4.6 as printed"),
        pytest.param(1, 4, "0.970 -0.42 -1.47 -8.48 11.34 0.970", id="1: and under the other sign"),
        pytest.param(1, 11, "20.8 23.6 25.6 23.9", id="1: the display's means that those imply"),
        pytest.param(2, 0, "-0.017 0.21 -0.0661 -5.26 -6.77", id="2: complex poles against real ones"),
        pytest.param(5, 0, "-12.2 0.5 0.1", id="5: the order of table 4.8 on the recovered means"),
        pytest.param(6, 0, "0.42 1.36 29 0.042 0.982", id="6: the weights of table 4.4"),
    ],
)
def test_the_figures_are_as_they_are_written(figures, number, first, written):
    texts = written.split()
    decimals = [len(text.partition(".")[2]) for text in texts]
    values = figures[number][first : first + len(texts)]
    assert [round(value, digits) for value, digits in zip(values, decimals)] == list(map(float, texts))


def test_what_else_holds_of_them(figures):
    assert abs(figures[1][10] - 20) > 100
    assert figures[2][5] == 0
    flash, battery, usb, *swapped = figures[3]
    assert swapped == pytest.approx([flash, usb, battery], rel=1e-12)
    assert flash + battery + usb == pytest.approx(1)
    assert len(figures[5]) == 3
    assert figures[6][::3] == [0.42, 0.042, 0.2]
    assert abs(figures[6][5] - 20) < 0.5
    assert figures[7] == [0.0, 16.07], "by the printed objective the worst model is perfect"
    assert figures[9] == [6, 6, 54, 0], "only the single-input model is symmetric"
    assert figures[10] == [pytest.approx(1), pytest.approx(20 - sensor_statistics()["1", "display"].mean_degC), -0.70]
    assert figures[11] == [0.90, 0.92, 6], "two figures for one error"


def test_1_the_implied_display_means_are_those_of_the_data_file():
    gains = dict(zip(("flash", "battery", "usb", "display"), (-0.421807, -1.472494, -8.475263, 11.339564)))
    for scenario in ("1", "2.1", "2.3", "2.4"):
        found = implied_display_degC(gains, scenario)
        assert found == pytest.approx(sensor_statistics()[scenario, "display"].mean_degC, abs=0.006)


@pytest.mark.slow
def test_8_the_missing_term_measured(runs):
    found = {each.number: each for each in computed_errata(runs.training, runs.evaluated["3"])}
    assert list(found) == [1, 2, 3, 5, 6, 7, 8, 9, 10, 11]
    without, with_term, without_trained, with_trained = [figure.value for figure in found[8].figures]
    # this air moves, and the simulated phone stores C dT/dt
    assert with_term < without
    assert with_trained < without_trained
