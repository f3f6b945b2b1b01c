"""Each way for a zone to teach nothing, and a real phone's."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ambient_model.faults import Refused
from ambient_trainer.data.trace import Trace
from ambient_trainer.selection.screen import screened

from .conftest import made_up

S25 = Path(__file__).parents[4] / "shared" / "measured" / "s25plus-zones" / "s25_zones_tidy.csv"


def with_column(values, name="odd_degC"):
    trace = made_up()
    return replace(trace, columns={name: values, **trace.columns})


def why(trace, name="odd_degC"):
    found = {each.column: each.why for each in screened([trace]).left_out}
    assert list(found) == [name]
    return found[name]


def test_nothing_is_wrong_with_good_zones(small):
    assert small.left_out == ()
    assert small.names == ["chip", "left", "loner", "mixed", "right"]


def test_an_empty_zone():
    assert why(with_column(np.full(1500, np.nan))) == "empty"


def test_a_zone_that_is_often_missing():
    values = made_up().columns["left_degC"] + 1.0
    values[200:400] = np.nan
    assert why(with_column(values)) == "13 % of its values are missing"


def test_a_dead_zone():
    assert why(with_column(np.where(np.arange(1500) < 700, -273.1, 20.0))) == "dead: it reads -273.1 degC"
    assert why(with_column(np.where(np.arange(1500) < 700, 1023.0, 20.0))) == "dead: it reads 1023 degC"


def test_a_constant_zone():
    assert why(with_column(np.full(1500, 25.0))) == "constant: 25 degC all the time"


def test_a_zone_that_hardly_moves():
    values = 25.0 + 0.01 * (np.arange(1500) % 3)
    assert why(with_column(values)).startswith(
        "stuck: it moves by 0.0082 degC (standard deviation), the median zone by "
    )


def test_a_zone_that_sticks_half_way():
    values = made_up().columns["mixed_degC"] + np.sin(np.arange(1500) / 7)
    values[600:1200] = 31.2
    said = why(with_column(values))
    assert said.startswith("stuck: 31.2 degC from 1200 s on for 1198 s, while the others moved by ")


def test_a_zone_that_reads_another_ones_sensor():
    values = made_up().columns["right_degC"] + 0.3
    trace = made_up()
    found = screened([replace(trace, columns={**trace.columns, "twin_degC": values})])
    assert [(each.column, each.why) for each in found.left_out] == [("twin_degC", "reads the same as right")]


def test_a_zone_that_one_trace_lacks():
    whole, short = made_up(0), made_up(1, path="other.csv")
    del short.columns["chip_degC"]
    found = screened([whole, short])
    assert [(each.column, each.why) for each in found.left_out] == [("chip_degC", "not in other.csv")]


def test_steps_and_noise_are_those_that_were_made():
    random = np.random.default_rng(0)
    slow = 30 + 10 * np.sin(np.arange(5000) / 800)
    columns = {
        "coarse_degC": np.round(slow),
        "fine_degC": np.round(slow + random.normal(scale=0.2, size=5000), 3),
        "ambient_degC": slow,
    }
    coarse, fine = screened([Trace("t.csv", np.arange(5000.0), columns)]).sensors
    assert coarse.step_degC == 1.0
    assert coarse.noise_degC == pytest.approx(1 / np.sqrt(12))
    assert fine.step_degC == pytest.approx(0.001)
    assert fine.noise_degC == pytest.approx(0.2, rel=0.05)


def test_a_trace_without_zones_is_refused():
    trace = made_up()
    with pytest.raises(Refused, match="no '_degC' column besides the reference"):
        screened([replace(trace, columns={"ambient_degC": trace.reference})])


@pytest.mark.skipif(not S25.exists(), reason="the measured zones of a phone are not here")
def test_a_real_phone_has_one_stuck_zone():
    names = S25.read_text().partition("\n")[0].split(",")
    table = np.genfromtxt(S25, delimiter=",", skip_header=1)
    columns = {f"{name.removeprefix('T_')}_degC": table[:, k] for k, name in enumerate(names) if name.startswith("T_")}
    columns["skin_degC"] = columns.pop("ambient_degC")
    found = screened([Trace(str(S25), table[:, 0], columns)])
    assert [each.column for each in found.left_out] == ["skin_degC"]
    assert found.left_out[0].why.startswith("stuck: it moves by 0.0")
    assert len(found.sensors) == 6
