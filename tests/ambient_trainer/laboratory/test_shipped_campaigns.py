"""The shipped campaigns are the thesis's scenarios: what the laboratory runs is what is simulated."""

import pytest

from ambient_trainer.laboratory.campaign import campaign_names, campaign_path, load_campaign
from ambient_trainer.laboratory.rows import signals_while
from ambient_trainer.simulator import constants as c
from ambient_trainer.simulator.constants import Activity
from ambient_trainer.simulator.scenario import load_scenario, scenario_names
from ambient_trainer.simulator.zones import THESIS_ZONES


def shipped(name):
    return load_campaign(campaign_path(name), ports=False).campaign


def program(steps):
    return [(step.duration_min, step.chamber_degC, *(step.load or ("idle",))) for step in steps]


def scenario(steps):
    return [(step.duration_min, step.chamber_degC, step.activity.value) for step in steps]


def test_every_scenario_ships():
    assert campaign_names() == scenario_names() == ("1", "2.1", "2.2", "2.3", "2.4", "2.5", "3", "4", "5")


@pytest.mark.parametrize("name", scenario_names())
def test_the_program_is_the_simulated_scenario_s(name):
    campaign, simulated = shipped(name), load_scenario(name)
    assert program(campaign.before) == scenario(simulated.before)
    assert program(campaign.steps) == scenario(simulated.steps)
    assert campaign.about == simulated.about


@pytest.mark.parametrize("name", scenario_names())
def test_a_program_waits_for_rest_once_before_it_is_recorded(name):
    first, *others = shipped(name).program
    assert first.settle is not None
    assert [step.settle for step in others] == [None] * len(others)


def test_all_share_one_laboratory_which_logs_the_thesis_s_sensors():
    laboratories = {shipped(name).laboratory.model_dump_json() for name in scenario_names()}
    assert len(laboratories) == 1
    device = shipped("5").laboratory.device
    assert tuple(device.zones.values()) == tuple(f"{zone}_degC" for zone in THESIS_ZONES)


@pytest.mark.parametrize("activity", list(Activity))
def test_signals_say_what_the_simulation_logs(activity):
    laboratory = shipped("5").laboratory
    said = signals_while(laboratory, () if activity is Activity.IDLE else (activity.value,))
    assert said["cpu_load_frac"] == c.CPU_LOAD_FRAC[activity]
    assert said["charging_on"] == (activity in c.CHARGING_A)
    assert said["camera_on"] == activity.value.startswith("camera")
    assert set(laboratory.actions) == {each.value for each in Activity} - {"idle"} | {"display"}


def test_a_name_that_is_none_is_refused_with_those_there_are():
    with pytest.raises(Exception, match=r"campaign: none is called '6'; take one of 1, 2\.1, .*, 5, or a \.yaml file"):
        campaign_path("6")
