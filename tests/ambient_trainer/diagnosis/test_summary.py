"""What a machine and a terminal get of a diagnosis: the contract's keys, no NaN, and sentences that stand alone."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console

from ambient_trainer.diagnosis.result import Cause, Gain
from ambient_trainer.diagnosis.summary import as_json, headline, misfit_table, remarks, show
from ambient_trainer.diagnosis.words import chance, clock, duration, figures, share, window

STEP = {
    "cause", "location", "signal", "onset_s", "end_s", "magnitude", "confidence", "gain", "indistinguishable_from",
}  # fmt: skip


def shown(diagnosis, width=140):
    console = Console(width=width, record=True, file=open("/dev/null", "w"))  # noqa: SIM115
    with console.file:
        show(console, diagnosis)
        return console.export_text()


def test_the_contract_is_met(made):
    data = json.loads(json.dumps(as_json(made()), allow_nan=False))

    assert {"steps", "verdict", "ranking", "residuals", "next_experiment"} <= set(data)
    assert len(data["steps"]) == 2
    assert data["verdict"] == data["steps"][0]
    first = data["verdict"]
    assert set(first) >= STEP
    assert (first["cause"], first["location"], first["signal"]) == ("heat_source", "flash", "camera_on")
    assert (first["onset_s"], first["end_s"]) == (3600.0, 5400.0)
    assert first["magnitude"]["value"] == 0.82
    assert first["magnitude"]["unit"] == "W"
    assert first["magnitude"]["ci95"] == [0.78, 0.86]
    assert first["gain"] == {
        "rmse_before_degC": 0.91, "rmse_after_degC": 0.43, "ci95_degC": [0.4, 0.55], "p_value": 2e-5, "held_out": True,
    }  # fmt: skip
    assert first["indistinguishable_from"] == [{"cause": "contact", "location": "flash", "signal": None}]
    assert data["steps"][1]["end_s"] is None
    assert data["ranking"][0]["remark"] == "taken"
    assert data["ranking"][2]["magnitude"] is None


def test_nothing_missing_has_the_same_keys(made):
    whole = as_json(made())
    data = json.loads(json.dumps(as_json(made(steps=(), verdict=None)), allow_nan=False))

    assert data["steps"] == []
    assert data["verdict"]["cause"] == "none"
    assert set(data["verdict"]) == set(whole["verdict"])
    assert data["verdict"]["gain"] is None


def test_the_residuals_are_every_sensors(made):
    diagnosis = made()
    data = as_json(diagnosis)["residuals"]

    assert list(data["sensors"]) == ["flash", "battery"]
    battery = diagnosis.misfit.residual_degC[1]
    known = battery[~np.isnan(battery)]
    assert data["sensors"]["battery"]["rmse_degC"] == pytest.approx(math.sqrt(np.mean(known**2)))
    assert data["sensors"]["battery"]["std_degC"] == pytest.approx(np.std(known))
    assert data["sensors"]["flash"]["memory_s"] > 100
    assert len(data["tests"]) == len(diagnosis.misfit.tests) > 10
    assert data["heat_unit"] == "K/s"


def test_what_is_no_number_is_null(made):
    diagnosis = made()
    misfit = replace(diagnosis.misfit, measured_degC=np.full_like(diagnosis.misfit.measured_degC, np.nan))
    step = replace(diagnosis.steps[0], gain=Gain(1.0, 0.5, (math.nan, math.inf), math.nan), confidence=math.nan)
    data = json.loads(json.dumps(as_json(made(misfit=misfit, steps=(step,), verdict=step)), allow_nan=False))

    assert data["verdict"]["gain"]["ci95_degC"] == [None, None]
    assert data["verdict"]["gain"]["p_value"] is None
    assert data["residuals"]["sensors"]["flash"] == {"rmse_degC": None, "std_degC": None, "memory_s": None}
    assert "flash" in shown(made(misfit=misfit, steps=(step,), verdict=step))


def test_the_headline_says_cause_window_size_and_gain(made):
    said = headline(made())
    for fact in ("at flash", "driven by camera_on", "from 1:00:00 to 1:30:00", "0.820 W (0.780 to 0.860 W)",
                 "from 0.910 to 0.430 degC", "0.400 to 0.550 degC", "p < 0.001"):  # fmt: skip
        assert fact in said
    nothing = headline(made(steps=(), verdict=None))
    assert nothing.startswith("Nothing is missing")
    assert "57" in nothing
    assert "two_nodes" in nothing
    step = replace(made().steps[0], cause=Cause("unknown"), sentence="The simulation is 0.91 degC off.")
    assert "The simulation is 0.91 degC off." in headline(made(steps=(step,), verdict=step))


def test_the_headline_holds_how_a_magnitude_varies(made):
    size = replace(made().steps[0].magnitude, qualifier="growing in the cold by 3.0 % per K")
    step = replace(made().steps[0], magnitude=size)
    assert "(0.780 to 0.860 W), growing in the cold by 3.0 % per K: " in headline(made(steps=(step,), verdict=step))


def test_the_terminal_shows_steps_remarks_and_notes(made):
    text = " ".join(shown(made(), 200).split())
    for fact in ("0:33:20", "-0.310 (-0.360 to -0.270)", "0.910 → 0.430", "explains the same with more",
                 "contact at flash", "switch camera_on on for 20 min", "The first 10 min"):  # fmt: skip
        assert fact in text


def test_the_terminal_tells_what_the_residual_goes_along_with_before_that_it_is_not_white(made):
    lines = shown(made(), 200).splitlines()
    first = next(at for at, line in enumerate(lines) if "tests of the residual are beyond chance" in line) + 1
    beyond = int(lines[first - 1].split()[0])
    told = [line.split(":")[0].strip() for line in lines[first : first + 8]]
    of_whiteness = [name in ("whiteness", "periodogram", "memory") for name in told]
    assert not of_whiteness[0]
    assert of_whiteness == sorted(of_whiteness)
    assert lines[first + 8] == f"  and {beyond - 8} more: --report or --json shows them all."


def test_nothing_to_remark_is_nothing(made):
    assert remarks(made(steps=(), verdict=None, next_experiment="", notes=())) == []


def test_the_tests_that_failed_come_first(made):
    table = misfit_table(made().misfit.tests)
    verdicts = [row[-1] for row in table.rows]
    assert verdicts == sorted(verdicts, reverse=True)
    assert {"yes", "no"} == set(verdicts)


@pytest.mark.parametrize(
    ("said", "expected"),
    [
        (clock(3725.4), "1:02:05"), (clock(0.0), "0:00:00"), (clock(-61), "-0:01:01"), (clock(-0.2), "0:00:00"),
        (clock(360_000), "100:00:00"), (clock(59.5), "0:01:00"),
        (duration(12.34), "12 s"), (duration(119), "120 s"), (duration(300), "5.0 min"), (duration(7200), "2.0 h"),
        (figures(0.8249), "0.825"), (figures(-12.35, 2), "-12"), (figures(9.999), "10.0"), (figures(0), "0"),
        (figures(12345.6), "12300"), (figures(1e-7), "1.00e-07"), (figures(math.nan), "-"),
        (share(0.5), "50 %"), (share(0.004), "0.4 %"), (chance(0.0004), "p < 0.001"), (chance(0.034), "p = 0.034"),
        (window(None, None), "all the time"), (window(None, 60), "from the start to 0:01:00"),
    ],
)  # fmt: skip
def test_numbers_are_put_before_people(said, expected):
    assert said == expected
