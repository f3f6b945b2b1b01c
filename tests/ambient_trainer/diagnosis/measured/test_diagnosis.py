"""``ambient-trainer diagnose`` on measured data, by the command itself."""

import json
import sys
from pathlib import Path

import pytest

from ambient_trainer.cli.main import main

CASES = {
    "O5": ("twinhouse", ("O5",), ()),
    "N2": ("twinhouse", ("N2",), ()),
    "closed": ("rpi3-case-fan", ("closed", "closed_but_for_a_side"), ("--baseline", "naked")),
    "closed_alone": ("rpi3-case-fan", ("closed",), ("--baseline", "naked")),
    "holed": ("rpi3-case-fan", ("holed",), ("--baseline", "naked")),
    "fan_in": ("rpi3-case-fan", ("fan_in",), ("--baseline", "naked")),
    "fan_out": ("rpi3-case-fan", ("fan_out",), ("--baseline", "naked")),
    "naked": ("rpi3-case-fan", ("naked",), ("--baseline", "naked")),
    "cells": ("lg-m50-cell", ("cell_0", "cell_10", "cell_25"), ()),
    "cell_2C": ("lg-m50-cell", ("cell_2C",), ()),
    "s25": ("s25plus-zones", ("s25",), ()),
}
"""By name: the circuit, the traces, and what else is said to the command."""


@pytest.fixture(scope="session")
def diagnosed(measured, circuit, tmp_path_factory):
    """The JSON of a case, diagnosed once a session."""
    folder = tmp_path_factory.mktemp("diagnosed")

    def of(case: str) -> dict:
        path = folder / f"{case}.json"
        if not path.exists():
            name, traces, more = CASES[case]
            options = [measured(each) if before == "--baseline" else each for before, each in zip(("", *more), more)]
            _run("diagnose", *map(measured, traces), "--circuit", circuit(name), *options, "--json", str(path))
        return json.loads(Path(path).read_text(encoding="utf-8"))

    return of


def _run(*arguments: str) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["ambient-trainer", *arguments])
        with pytest.raises(SystemExit) as stopped:
            main()
    assert stopped.value.code == 0


def first(diagnosis: dict, cause: str, location: str | None, signal: str | None = None) -> dict:
    """The first step, which must be this one, with a held-out gain that chance does not explain."""
    step = diagnosis["steps"][0]
    assert (step["cause"], step["location"], step["signal"]) == (cause, location, signal)
    surely_gains(step)
    return step


def surely_gains(step: dict) -> None:
    """The interval of the held-out gain excludes zero and holds the gain itself."""
    gain = step["gain"]
    low, high = gain["ci95_degC"]
    assert gain["held_out"] is True
    assert gain["p_value"] < 0.01
    assert 0 < low < gain_degC(step) < high


def gain_degC(step: dict) -> float:
    """By how much the held-out error falls."""
    return step["gain"]["rmse_before_degC"] - step["gain"]["rmse_after_degC"]


def rivals(step: dict) -> list[tuple[str, str | None]]:
    """The causes from which the step is not distinguishable, and where."""
    return [(each["cause"], each["location"]) for each in step["indistinguishable_from"]]


@pytest.mark.slow
def test_the_sun_through_opened_blinds_heats_the_living_room(diagnosed):
    step = diagnosed("O5")["steps"][0]
    assert (step["cause"], step["location"], step["signal"]) == ("heat_source", "living", "irradiance_south_W_m2")
    assert step["magnitude"]["unit"] == "W per W/m2"
    assert 1.0 < step["magnitude"]["value"] < 5.0
    assert step["magnitude"]["ci95"][0] > 0
    assert step["gain"]["rmse_before_degC"] < 2.0
    assert gain_degC(step) > 0.4
    # of the planes only the horizontal one, which sees the same sun, comes near the one that has the windows
    assert {(each["location"], each["signal"]) for each in step["indistinguishable_from"]} <= {
        ("living", "irradiance_W_m2")
    }


@pytest.mark.slow
def test_behind_closed_blinds_the_sun_heats_half_as_much_at_most(diagnosed):
    opened = diagnosed("O5")["steps"][0]["magnitude"]["value"]
    suns = [each for each in diagnosed("N2")["steps"] if (each["signal"] or "").startswith("irradiance")]
    assert max((each["magnitude"]["value"] for each in suns), default=0.0) <= 0.5 * opened


@pytest.mark.slow
def test_a_closed_case_keeps_the_heat_in(diagnosed):
    alone = first(diagnosed("closed_alone"), "ambient_coupling", "desk")
    assert alone["magnitude"]["ci95"][0] > 0
    step = first(diagnosed("closed"), "ambient_coupling", "desk")
    assert 2.0 < step["magnitude"]["ci95"][0] < step["magnitude"]["value"] < 5.0
    assert step["gain"]["rmse_after_degC"] < 0.2 * step["gain"]["rmse_before_degC"]
    assert rivals(step) == []


@pytest.mark.slow
def test_a_lid_with_holes_keeps_less_of_it(diagnosed):
    step = first(diagnosed("holed"), "ambient_coupling", "desk")
    assert 0.3 < step["magnitude"]["value"] < 0.9 * diagnosed("closed")["steps"][0]["magnitude"]["value"]
    assert (step["onset_s"], step["end_s"]) == (None, None)


@pytest.mark.slow
@pytest.mark.parametrize(("case", "change"), [("fan_in", -0.49), ("fan_out", -0.43)])
def test_a_fan_takes_the_heat_away(diagnosed, case, change):
    step = first(diagnosed(case), "ambient_coupling", "board")
    assert step["magnitude"]["value"] == pytest.approx(change, abs=0.08)
    assert step["magnitude"]["ci95"][1] < 0
    assert step["gain"]["rmse_after_degC"] < 0.1 * step["gain"]["rmse_before_degC"]
    # one sensor does not distinguish it from other ways for the heat, but from a fault of its own
    assert not [cause for cause, _ in rivals(step) if cause.startswith("sensor")]


@pytest.mark.slow
def test_of_the_naked_board_itself_nothing_has_changed(diagnosed):
    assert diagnosed("naked")["steps"] == []
    assert diagnosed("naked")["verdict"]["cause"] == "none"


@pytest.mark.slow
def test_the_current_squared_heats_a_cell(diagnosed):
    """At 0, 10 and 25 degC: that it heats more in the cold does not foretell a temperature that was left out."""
    step = first(diagnosed("cells"), "heat_source", "cell", "current_A^2")
    assert step["magnitude"]["unit"] == "W/A^2"
    assert step["magnitude"]["value"] == pytest.approx(0.0192, rel=0.25)
    assert step["gain"]["rmse_after_degC"] < 0.4 * step["gain"]["rmse_before_degC"]
    assert rivals(step) == []


@pytest.mark.slow
def test_at_one_temperature_it_is_the_current_squared(diagnosed):
    step = diagnosed("cell_2C")["steps"][0]
    assert (step["cause"], step["location"], step["signal"]) == ("heat_source", "cell", "current_A^2")
    assert step["magnitude"]["unit"] == "W/A^2"
    assert step["magnitude"]["value"] == pytest.approx(0.032, rel=0.15)
    # on folds that are foretold, not bridged
    assert step["gain"]["rmse_after_degC"] < 0.6 * step["gain"]["rmse_before_degC"]
    # the current never changes while it flows: heat that is there as long does as well, and nothing else
    assert set(rivals(step)) <= {("heat_source", "cell")}


@pytest.mark.slow
def test_the_zone_named_ambient_is_stuck(diagnosed):
    step = diagnosed("s25")["steps"][0]
    assert (step["cause"], step["location"], step["signal"]) == ("sensor_stuck", "skin", None)
    assert step["magnitude"]["value"] == pytest.approx(25.46, abs=0.05)
    assert (step["onset_s"], step["end_s"]) == (None, None)
    assert rivals(step) == []
