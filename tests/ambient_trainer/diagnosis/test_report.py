"""What a machine and a reader get of a diagnosis: the contract's keys, no NaN, every figure in its place."""

import io
import json
import math
from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console

from ambient_trainer.diagnosis import figures
from ambient_trainer.diagnosis.report import headline, report_of, residual_tests_table
from ambient_trainer.diagnosis.result import Cause, Gain
from ambient_trainer.report.terminal import print_report
from ambient_trainer.report.words import chance, clock, digits, duration, share, window


def shown(diagnosis):
    console = Console(width=200, file=io.StringIO())
    print_report(console, report_of(diagnosis))
    return console.file.getvalue()


def data_of(diagnosis):
    return json.loads(json.dumps(report_of(diagnosis).data, allow_nan=False))


def test_figures_are_the_diagnosis_own_and_nothing_missing_has_every_key(made):
    data = data_of(made())
    first, second = data["steps"]
    assert (first["onset_s"], first["end_s"], second["end_s"]) == (3600.0, 5400.0, None)
    assert first["magnitude"].items() >= {"value": 0.82, "unit": "W", "ci95": [0.78, 0.86]}.items()
    assert first["gain"] == {
        "rmse_before_degC": 0.91, "rmse_after_degC": 0.43, "ci95_degC": [0.4, 0.55], "p_value": 2e-5, "held_out": True,
    }  # fmt: skip
    assert first["indistinguishable_from"] == [{"cause": "contact", "location": "flash", "signal": None}]
    assert data["ranking"][2]["magnitude"] is None
    nothing = data_of(made(steps=(), verdict=None))
    assert nothing["steps"] == []
    assert nothing["verdict"]["cause"] == "none"
    assert set(nothing["verdict"]) == set(data["verdict"])
    assert nothing["verdict"]["gain"] is nothing["verdict"]["confidence"] is None


def test_a_note_follows_the_headline_whatever_was_found(made):
    for diagnosis in (made(), made(steps=(), verdict=None, next_experiment="")):
        text = shown(replace(diagnosis, notes=("9 readings were set aside",)))
        assert text.index(headline(diagnosis)[:20]) < text.index("9 readings") < text.index("Residuals")
        assert "What would show more" not in text
    assert report_of(made()).title.endswith("camera_on and 1 more, 0.91 to 0.08 degC on held-out data")


def test_the_residuals_are_every_sensors_and_what_is_no_number_is_null(made):
    diagnosis = made()
    data = data_of(diagnosis)["residuals"]
    assert list(data["sensors"]) == ["flash", "battery"]
    battery = diagnosis.misfit.residual_degC[1]
    known = battery[~np.isnan(battery)]
    assert data["sensors"]["battery"]["rmse_degC"] == pytest.approx(math.sqrt(np.mean(known**2)))
    assert data["sensors"]["battery"]["std_degC"] == pytest.approx(np.std(known))
    assert data["sensors"]["flash"]["memory_s"] > 100
    assert len(data["tests"]) == len(diagnosis.misfit.tests) > 10
    assert data["heat_unit"] == "K/s"
    misfit = replace(diagnosis.misfit, measured_degC=np.full_like(diagnosis.misfit.measured_degC, np.nan))
    step = replace(diagnosis.steps[0], gain=Gain(1.0, 0.5, (math.nan, math.inf), math.nan), confidence=math.nan)
    empty = made(misfit=misfit, steps=(step,), verdict=step)
    data = data_of(empty)
    assert data["verdict"]["gain"]["ci95_degC"] == [None, None]
    assert data["verdict"]["gain"]["p_value"] is None
    assert data["residuals"]["sensors"]["flash"] == {"rmse_degC": None, "std_degC": None, "memory_s": None}
    assert "flash" in shown(empty)


def test_the_headline_says_of_the_size_what_it_grows_with_of_nothing_what_was_tried_and_of_unknown_how_far_it_is(made):
    size = replace(made().steps[0].magnitude, qualifier="growing in the cold by 3.0 % per K")
    assert size.qualifier in headline(made(verdict=replace(made().steps[0], magnitude=size)))
    assert all(each in headline(made(steps=(), verdict=None)) for each in ("57 candidates", "two_nodes"))
    law = replace(made().steps[0], cause=Cause("convection_law", "flash"), gain=Gain(0.91, 0.43, (0.4, 0.55), 0.24))
    assert "not proportional" in headline(made(verdict=law))
    assert ["p = 0.24" in headline(made(verdict=law)), "p < 0.001" in headline(made())] == [False, True]
    unknown = replace(made().steps[0], cause=Cause("unknown"), sentence="The simulation is 0.91 degC off.")
    assert "0.91 degC off" in headline(made(steps=(unknown,), verdict=unknown))


def test_the_terminal_shows_significant_tests_first(made):
    text = shown(made())
    lines = text.splitlines()
    first = next(at for at, line in enumerate(lines) if "tests of the residual are significant" in line)
    tests = [line.split(":")[0] for line in lines[first + 1 : first + 9]]
    white = [name in ("whiteness", "periodogram", "memory") for name in tests]
    assert white == sorted(white)
    assert not white[0]
    assert str(int(lines[first].split()[0]) - 8) in lines[first + 9]
    verdicts = [row[-1] for row in residual_tests_table(made().misfit.tests).rows]
    assert verdicts == sorted(verdicts, reverse=True)
    assert ["too small" in each for each in (text, shown(made(steps=(), verdict=None)))] == [False, True]
    assert set(verdicts) == {"yes", "no"}


def test_beneath_the_heat_is_what_drives_the_causes_and_a_window_is_shaded_in_every_plot(made):
    def panels(diagnosis):
        return {each.name for each in figures.heat(diagnosis).data}

    assert "camera_on" in panels(made())
    assert "cpu_load_frac" not in panels(made())
    first, second = made().steps
    step = replace(first, cause=Cause("contact", "flash"))
    idle = {**made().signals, "charging_on": 0 * made().time_s}
    free = panels(made(steps=(step, second), verdict=step, signals=idle))
    assert "cpu_load_frac" in free
    assert "charging_on" not in free
    for draw in (figures.simulated, figures.heat, figures.residuals, figures.ambient):
        assert any((each.x0, each.x1) == (60.0, 90.0) for each in draw(made()).layout.shapes)  # in minutes


def test_heat_in_proportion_to_its_driver_is_a_straight_line(made):
    diagnosis = made()
    driver = np.linspace(0.0, 4.0, len(diagnosis.time_s))
    row = diagnosis.misfit.sensors.index("flash")

    def with_heat(flow):
        heat = diagnosis.misfit.heat.copy()
        heat[row] = flow
        signals = {**diagnosis.signals, "camera_on": driver}
        return made(signals=signals, misfit=replace(diagnosis.misfit, heat=heat))

    gone = np.arange(len(driver)) % 7 == 0
    proportional = with_heat(np.where(gone, np.nan, 0.5 * driver - 0.2))
    assert figures.heat_by_driver(proportional) == ("camera_on", "flash")
    points, line = figures.against_driver(proportional, "camera_on", "flash").data
    assert len(points.x) == 300
    assert points.y == pytest.approx(0.5 * points.x - 0.2)
    assert line.y == pytest.approx(0.5 * line.x - 0.2)
    assert figures.heat_by_driver(with_heat(np.nan)) is None


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (clock(3725.4), "1:02:05"), (clock(0.0), "0:00:00"), (clock(-61), "-0:01:01"), (clock(-0.2), "0:00:00"),
        (clock(360_000), "100:00:00"), (clock(59.5), "0:01:00"),
        (duration(12.34), "12 s"), (duration(119), "120 s"), (duration(300), "5.0 min"), (duration(7200), "2.0 h"),
        (digits(0.8249), "0.825"), (digits(-12.35, 2), "-12"), (digits(9.999), "10.0"), (digits(0), "0"),
        (digits(12345.6), "12300"), (digits(1e-7), "1.00e-07"), (digits(math.nan), "-"),
        (share(0.5), "50 %"), (share(0.004), "0.4 %"), (chance(0.0004), "p < 0.001"), (chance(0.034), "p = 0.034"),
        (window(None, None), "all the time"), (window(None, 60), "from the start to 0:01:00"),
    ],
)  # fmt: skip
def test_numbers_as_text(text, expected):
    assert text == expected
