"""Chau's line: a world made by it, and which samples it learns from."""

from dataclasses import replace

import numpy as np
import pytest

from ambient_model.faults import Refused
from ambient_studies.related import chau
from ambient_trainer.data.trace import Trace


def idle_world(seed: int, slope: float = 0.9, offset: float = -1.5) -> Trace:
    """An hour idle, drifting slowly enough to count as stable; 20 min busy, 20 K warmer; 10 min of cooling, idle."""
    rng = np.random.default_rng(seed)
    time_s = np.arange(5400.0)
    idle = 15.0 + 10.0 * np.sin(time_s / 20000.0 + seed)
    busy = (time_s >= 3600.0) & (time_s < 4800.0)
    columns = {
        "battery_degC": idle + 20.0 * np.where(busy, 1.0, np.exp(-(time_s - 4800.0) / 400.0) * (time_s >= 4800.0)),
        "cpu_load_frac": np.where(busy, 0.2, 0.03),
        "charging_on": np.zeros(5400),
        "ambient_degC": slope * idle + offset + rng.normal(0.0, 0.2, 5400),
    }
    return Trace(f"idle world {seed}", time_s, columns)


def test_the_line_of_a_world_made_by_one_comes_back() -> None:
    traces = [idle_world(1), idle_world(3)]

    line = chau.fit(traces)

    learned = np.concatenate([trace.columns["battery_degC"][300:3600] for trace in traces])
    error = 0.2 / np.sqrt(len(learned)) / learned.std()
    assert line.slope == pytest.approx(0.9, abs=4 * error)
    assert line.slope * learned.mean() + line.offset_degC == pytest.approx(0.9 * learned.mean() - 1.5, abs=0.02)


def test_the_pocket_has_a_line_of_its_own() -> None:
    out, pocket = chau.fit([idle_world(1)]), chau.fit([idle_world(1, slope=0.5, offset=2.0)])

    assert (out.slope, pocket.slope) == pytest.approx((0.9, 0.5), abs=0.05)


def test_it_is_applied_whatever_the_phone_does() -> None:
    trace = idle_world(1)

    found = chau.Line(0.5, 3.0).estimate(trace)

    assert np.array_equal(found, 0.5 * trace.columns["battery_degC"] + 3.0)


def test_a_battery_is_stable_when_it_is_where_it_was_five_minutes_before() -> None:
    time_s = np.arange(0.0, 1200.0, 10.0)
    battery = np.where(time_s < 600.0, 20.0, 21.0)

    found = chau.stable(time_s, battery, np.ones(120, dtype=bool))

    assert np.array_equal(found, ((time_s >= 300.0) & (time_s < 600.0)) | (time_s >= 900.0))


def test_a_battery_is_not_stable_within_five_minutes_of_work() -> None:
    time_s = np.arange(0.0, 1200.0, 10.0)
    idle = (time_s < 400.0) | (time_s > 600.0)

    found = chau.stable(time_s, np.full(120, 35.0), idle)

    assert np.array_equal(found, ((time_s >= 300.0) & (time_s < 400.0)) | (time_s > 900.0))


@pytest.mark.parametrize("column", ["cpu_load_frac", "charging_on"])
def test_a_busy_phone_teaches_nothing(column: str) -> None:
    trace = idle_world(1)
    busy = replace(trace, columns={**trace.columns, column: np.ones(5400)})

    with pytest.raises(Refused) as refused:
        chau.fit([busy])

    assert str(refused.value) == (
        "idle world 1: 0 samples of an idle phone with a stable battery, at fewer than two temperatures; "
        "log the idle phone at several ambient temperatures"
    )
