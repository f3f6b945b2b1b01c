"""Each way for a zone to be of no use, and a real phone's."""

from dataclasses import replace

import numpy as np
import pytest

from ambient_trainer.data.trace import Trace
from ambient_trainer.selection.screen import screened
from refusals import refused

from .conftest import made_up

EARLY = np.arange(1500) < 700


def reasons(*traces):
    return screened(traces)[1]


def test_good_zones_stay_and_one_that_a_trace_lacks_goes(small):
    assert small.left_out == {}
    assert small.names == ("chip", "left", "loner", "mixed", "right")
    short = made_up(1, path="other.csv")
    del short.columns["chip_degC"]
    assert reasons(made_up(0), short) == {"chip_degC": "not in other.csv"}
    trace = made_up()
    joined = replace(trace, columns={**trace.columns, "ambient_2_degC": trace.reference + 0.1})
    assert list(reasons(joined)) == ["ambient_2_degC"]
    assert "_degC" in str(refused(screened, [replace(trace, columns={"ambient_degC": trace.reference})]))


@pytest.mark.parametrize(
    ("values", "reason"),
    [
        (np.full(1500, np.nan), "empty"),
        (np.where((np.arange(1500) >= 200) & (np.arange(1500) < 400), np.nan, made_up().reference), "13 %"),
        (np.where(EARLY, -273.1, 20.0), "dead: it reads -273.1 degC"),
        (np.where(EARLY, 1023.0, 20.0), "dead: it reads 1023 degC"),
        (np.full(1500, 25.0), "constant: 25 degC"),
        (25.0 + 0.01 * (np.arange(1500) % 3), "stuck: it moves by 0.0082 degC"),
        (np.where(EARLY, 31.2, made_up().columns["mixed_degC"] + 1.0), "stuck: 31.2 degC from 0 s on for 1398 s"),
        (made_up().columns["right_degC"] + 0.3, "reads the same as right"),
    ],
)
def test_a_zone_of_no_use_is_left_out_with_the_reason(values, reason):
    trace = made_up()
    left = reasons(replace(trace, columns={**trace.columns, "odd_degC": values}))
    assert list(left) == ["odd_degC"]
    assert left["odd_degC"].startswith(reason)


def test_steps_and_noise_are_those_that_were_made():
    random = np.random.default_rng(0)
    slow = 30 + 10 * np.sin(np.arange(5000) / 800)
    columns = {
        "coarse_degC": np.round(slow),
        "fine_degC": np.round(slow + random.normal(scale=0.2, size=5000), 3),
        "ambient_degC": slow,
    }
    coarse, fine = screened([Trace("t.csv", np.arange(5000.0), columns)])[0]
    assert coarse.step_degC == 1.0
    assert coarse.noise_degC == pytest.approx(1 / np.sqrt(12))
    assert fine.step_degC == pytest.approx(0.001)
    assert fine.noise_degC == pytest.approx(0.2, rel=0.05)


def test_a_real_phone_has_one_stuck_zone(beside):
    path = beside("measured/s25plus-zones/s25_zones_tidy.csv")
    names = path.read_text().partition("\n")[0].split(",")
    table = np.genfromtxt(path, delimiter=",", skip_header=1)
    columns = {f"{name.removeprefix('T_')}_degC": table[:, k] for k, name in enumerate(names) if name.startswith("T_")}
    columns["skin_degC"] = columns.pop("ambient_degC")
    trace = Trace(str(path), table[:, 0], columns)
    assert list(reasons(trace)) == ["skin_degC"]
    assert reasons(trace)["skin_degC"].startswith("stuck: it moves by 0.0")
    assert len(screened([trace])[0]) == 6
