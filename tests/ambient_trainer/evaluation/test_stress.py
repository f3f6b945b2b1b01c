"""Every condition of a stress has its row, whatever the period, and where nothing can be estimated it says so."""

from dataclasses import replace

import numpy as np
import pytest

from ambient_trainer.data.trace import save_trace
from ambient_trainer.evaluation.stress import FAULTS, stress

from .conftest import sensor_trace, two_sensor_model


@pytest.mark.parametrize("period_s", [1.0, 3600.0])
def test_all_conditions_are_scored_at_any_period(period_s):
    model = two_sensor_model(periods_s=(period_s,))
    found = {each.condition: each for each in stress(model, sensor_trace(300, period_s=period_s))}
    assert sum(": " in name for name in found) == 2 * len(FAULTS)
    logged, wrong = found["as logged"], found["usb: 85 degC"]
    assert logged.tracking > 0.5
    assert stress(model, sensor_trace(300, period_s=period_s), from_s=200 * period_s)[0].tracking == 1.0
    # this model does not validate: 1.3 of 55 degC or more is what such a lie does, from the second sample on
    assert wrong.rmse_degC > 40
    assert wrong.tracking_off == pytest.approx(1.0)


def test_a_condition_that_leaves_no_estimate_is_a_row_without_errors(saved, figures, tmp_path):
    model, trace = two_sensor_model(), sensor_trace(300)
    # so low a range that no truncated reading lies in it
    model = model._replace(main=model.main._replace(inputs=tuple(e._replace(min=24.2) for e in model.main.inputs)))
    read = 24.3 + 0.6 * np.random.default_rng(0).random(300)
    columns = {**trace.columns, "usb_degC": read, "battery_degC": read}
    save_trace(str(tmp_path / "t.csv"), replace(trace, columns=columns))
    found, _ = figures("evaluate", saved(model), tmp_path / "t.csv", "--stress")
    rows = {each["condition"]: each for each in found["stress"]}
    told = [rows["truncated to 1 degC"][name] for name in ("rmse_degC", "largest_degC", "coverage90", "tracking")]
    assert told == [None, None, None, 0]
    assert rows["as logged"]["rmse_degC"] > 0
