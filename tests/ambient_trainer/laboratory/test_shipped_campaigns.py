"""The thesis's scenarios are campaigns, too: one file each, which the laboratory runs and the simulation computes."""

import pytest

from ambient_trainer.laboratory.campaign import load_campaign
from ambient_trainer.laboratory.rows import signals_while
from ambient_trainer.simulator import constants as c
from ambient_trainer.simulator.constants import Activity
from ambient_trainer.simulator.scenario import load_scenario, scenario_names, scenario_path
from ambient_trainer.simulator.zones import THESIS_ZONES


def shipped(name):
    return load_campaign(scenario_path(name), ports=False).campaign


@pytest.mark.parametrize("name", scenario_names())
def test_a_scenario_is_a_campaign_that_settles_once_before_it_is_recorded(name):
    campaign = shipped(name)
    assert campaign.program == load_scenario(name).program
    assert [step.settle is not None for step in campaign.program] == [True] + [False] * (len(campaign.program) - 1)


def test_all_share_one_laboratory_which_logs_the_thesis_s_sensors():
    laboratories = {shipped(name).laboratory.model_dump_json() for name in scenario_names()}
    assert len(laboratories) == 1
    device = shipped("5").laboratory.device
    assert tuple(device.zones.values()) == tuple(f"{zone}_degC" for zone in THESIS_ZONES)


@pytest.mark.parametrize("activity", list(Activity))
def test_signals_are_what_the_simulation_logs(activity):
    laboratory = shipped("5").laboratory
    logged = signals_while(laboratory, () if activity is Activity.IDLE else (activity.value,))
    assert logged["cpu_load_frac"] == c.CPU_LOAD_FRAC[activity]
    assert logged["charging_on"] == (activity in c.CHARGING_A)
    assert logged["camera_on"] == activity.value.startswith("camera")
    assert set(laboratory.actions) == {each.value for each in Activity} - {"idle"} | {"display"}
