"""What is told at the end, from records made by hand."""

import numpy as np
import pandas as pd

from ambient_trainer.laboratory.campaign import load_campaign
from ambient_trainer.laboratory.journal import Head, Record
from ambient_trainer.laboratory.messages import MULTIPLEXER, Failure, Note, Sample, StepBegan
from ambient_trainer.laboratory.report import column_table, events, expected, settling_table
from ambient_trainer.simulator.scenario import scenario_path

HEAD = Head("3", "", 0.0, 1.0, False)
CAMPAIGN = load_campaign(scenario_path("3"), ports=False).campaign


def scan(at_s, degC):
    return Sample(MULTIPLEXER, at_s, at_s, {f"probe_air{k}_degC": degC for k in range(1, 5)})


def test_columns_tell_what_they_lack():
    rows = pd.DataFrame({"a_degC": [1.0, np.nan, np.nan, 3.0], "b_degC": [np.nan, 2.0, 4.0, np.nan], "c_degC": np.nan})
    assert column_table(rows).rows == (
        ("a_degC", "2", "1", "2", "1.000", "2.000", "3.000"),
        ("b_degC", "2", "2", "1", "2.000", "3.000", "4.000"),
        ("c_degC", "0", "1", "4", "-", "-", "-"),
    )


def test_how_long_the_air_took_to_each_new_set_point():
    entries = [
        StepBegan(0.1, 0, 0.1),
        scan(100.0, 20.0),
        scan(800.0, 48.5),
        StepBegan(900.0, 1, 0.0),
        scan(1000.0, 40.0),
        scan(2500.0, -8.1),
        StepBegan(2700.0, 2, 0.0),
        scan(2800.0, 0.0),
    ]
    assert settling_table(Record(HEAD, tuple(entries)), CAMPAIGN).rows == (
        ("before 1", "50", "0:13:20"),
        ("1", "-10", "0:26:40"),
        ("2", "50", "never in its time"),
    )


def test_what_happened_is_told_with_its_time_and_trouble_is_counted():
    entries = [
        Note(3601.0, "resumed after 60 s"),
        *(Failure("chamber", at_s, "silent") for at_s in range(3)),
        Failure("device", 5.0, "gone"),
    ]
    assert events(Record(HEAD, tuple(entries))) == [
        "1:00:01  resumed after 60 s",
        "chamber: 3 failures",
        "device: 1 failure",
    ]
    many = events(Record(HEAD, tuple(Note(k, f"{k}") for k in range(50))))
    assert len(many) == 21
    assert many[-1] == "and 30 more"


def test_a_ramp_that_its_step_has_no_time_for_goes_on_in_the_next():
    link = CAMPAIGN.laboratory.instruments.chamber
    first, second, third = expected(CAMPAIGN)
    assert first.ramp_s == 60 * 30 / link.heating_K_min
    assert first.length_s == first.ramp_s + 600.0
    assert second.ramp_s == 60 * 60 / link.cooling_K_min
    assert third.begins_s == first.length_s + 1800.0
    hurried = CAMPAIGN.model_copy(update={"before": (), "steps": CAMPAIGN.steps[:1]})
    (only,) = expected(hurried)
    assert only.ramp_s == 60 * 30 / link.cooling_K_min
    steep = CAMPAIGN.steps[0].model_copy(update={"duration_min": 5.0, "gradient_K_min": 1.0})
    ramped = expected(CAMPAIGN.model_copy(update={"before": (), "steps": (steep, steep)}))
    assert [each.ramp_s for each in ramped] == [1800.0, 1500.0]
