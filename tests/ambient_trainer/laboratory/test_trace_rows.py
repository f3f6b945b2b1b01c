"""Records by hand: the rows of their traces, where what was said in a period stands, and what is told at the end."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ambient_trainer.laboratory.campaign import load_campaign
from ambient_trainer.laboratory.collect import Grid, grid_of, laboratory_rows, signals_while, trace_rows
from ambient_trainer.laboratory.journal import Head, JournalRecord
from ambient_trainer.laboratory.messages import DEVICE, MULTIPLEXER, End, LoadState, Sample, StepBegan
from ambient_trainer.simulator.scenario import scenario_path

CAMPAIGN = load_campaign(scenario_path("1"), ports=False).campaign
HEAD = Head("1", "", 0.0, 1.0, False)
FIRST = StepBegan(0.0, 0, 0.0)
ZONES = CAMPAIGN.laboratory.device.columns


def scan(asked_s, *temps, delay_s=0.2):
    values = {f"probe_air{k}_degC": temp for k, temp in enumerate(temps, 1)}
    return Sample(MULTIPLEXER, asked_s, asked_s + delay_s, values)


def zones(asked_s, degC, delay_s=0.1, **others):
    return Sample(DEVICE, asked_s, asked_s + delay_s, {**dict.fromkeys(ZONES, degC), **others})


def rows(*entries):
    record = JournalRecord(HEAD, (FIRST, StepBegan(100.3, 1, 0.0), *entries))
    grid = grid_of(record, CAMPAIGN)
    assert grid == Grid(100.0, 1.0)
    found = trace_rows(record, CAMPAIGN, grid).astype(object)
    return list(found.where(found.notna(), None).iterrows())


def test_each_cell_is_what_was_said_in_its_second():
    found = rows(
        scan(100.01, 20.0, 20.2, 20.4, 20.6),
        zones(100.02, 25.0),
        zones(101.0, 26.0),
        scan(102.0, 21.0, 21.0, None, 22.0),
        scan(103.0, 21.0, None, None, None),
        LoadState(102.5, ("cpu_100",)),
        End(103.9, "finished"),
    )
    assert [time_s for time_s, _ in found] == [0.0, 1.0, 2.0, 3.0]
    assert [row["ambient_degC"] for _, row in found] == [20.3, None, 21.3333, None]  # one of four is too few
    assert [row["soc_degC"] for _, row in found] == [25.0, 26.0, None, None]
    assert [row["cpu_load_frac"] for _, row in found] == [None, None, 1.0, 1.0]


def test_the_middle_of_asking_and_answering_counts_and_where_it_is_not_known_the_laboratory_s_file_has_it():
    found = rows(zones(101.0, 25.0, delay_s=1.9), zones(103.0, 26.0, delay_s=2.1), zones(105.9, 27.0), End(106.5, ""))
    assert [row["soc_degC"] for _, row in found] == [None, 25.0, None, None, None, 27.0, None]
    late = scan(101.0, 20.0, 20.0, delay_s=4.0)
    assert all(row["ambient_degC"] is None for _, row in rows(late, End(106.0, "")))
    beside = laboratory_rows(JournalRecord(HEAD, (StepBegan(0.0, 1, 0.0), late)), CAMPAIGN, Grid(100.0, 1.0))
    assert list(beside) == ["multiplexer_delay_s", "probe_air1_degC", "probe_air2_degC"]
    assert beside.reset_index().to_numpy().tolist() == [[3.0, 4.0, 20.0, 20.0]]


def test_a_stop_is_a_gap_in_which_nothing_is_known():
    found = rows(
        LoadState(99.0, ("camera_4k",)),
        zones(100.0, 25.0),
        End(101.9, "killed"),
        LoadState(101.95, None),
        StepBegan(105.2, 1, 1.6),
        LoadState(106.5, ("camera_4k",)),
        zones(106.0, 25.0),
        End(107.5, "killed again"),
    )
    assert [row["camera_on"] for _, row in found] == [1.0, None, None, None, None, None, 1.0, 1.0]
    assert [row["soc_degC"] for _, row in found] == [25.0, None, None, None, None, None, 25.0, None]


def test_the_grid_begins_with_the_recording_and_has_a_row_for_each_period():
    record = JournalRecord(HEAD, (FIRST, scan(3.0, 20.0)))
    assert grid_of(record, CAMPAIGN) is None
    whole = JournalRecord(HEAD, (*record.entries, StepBegan(10.0, 1, 0.0)))
    beside = laboratory_rows(whole, CAMPAIGN, grid_of(whole, CAMPAIGN))
    assert beside.reset_index().to_numpy().tolist() == [[-7.0, 0.2, 20.0]]
    record = JournalRecord(HEAD, (FIRST, StepBegan(900.4, 1, 0.0), StepBegan(2700.4, 2, 0.0), End(2712.0, "finished")))
    assert len(trace_rows(record, CAMPAIGN, grid_of(record, CAMPAIGN))) == 1800
    record = JournalRecord(HEAD, (FIRST, StepBegan(900.0, 1, 0.0), StepBegan(5000.0, 1, 300.0), End(5100.0, "")))
    assert grid_of(record, CAMPAIGN) == Grid(900.0, 1.0)


@given(st.lists(st.tuples(st.integers(0, 60), st.floats(0.0, 0.6), st.floats(-20, 60)), max_size=30))
def test_no_value_appears_that_was_not_said_in_its_second(asked):
    samples = [zones(100.0 + k + late, round(degC, 1), delay_s=0.1) for k, late, degC in sorted(asked)]
    said = {float(k): round(degC, 1) for k, _, degC in sorted(asked)}
    found = {time_s: row["soc_degC"] for time_s, row in rows(*samples, End(165.0, "")) if row["soc_degC"] is not None}
    assert found == said


def test_where_several_actions_speak_the_largest_counts():
    both = signals_while(CAMPAIGN.laboratory, ("cpu_50", "camera_4k", "charging"))
    assert both == {"charging_on": 1, "cpu_load_frac": 0.5, "camera_on": 1, "display_on": 1}
    assert signals_while(CAMPAIGN.laboratory, ()) == pytest.approx(CAMPAIGN.laboratory.signals)
