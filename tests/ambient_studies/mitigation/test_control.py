"""The phone under caps against one that asks for less; its sensors, sample by sample, against those of a whole run."""

from dataclasses import replace

import numpy as np
import pytest

from ambient_studies.mitigation.loop import skin_degC
from ambient_trainer.simulator.device import load_device
from ambient_trainer.simulator.live import Sensors
from ambient_trainer.simulator.run import Run, integrate, stream

PHONE = load_device()
ZONES = [PHONE.zone(name) for name in ("soc", "flash", "usb", "msm-skin", "pm8350", "battery-cell")]


@pytest.mark.parametrize("period_s", [0.5, 1.0, 5.0])
def test_sensors_sample_by_sample_are_those_of_a_whole_run(period_s):
    nodes = 40 + np.cumsum(np.random.default_rng(1).normal(0, 0.3, (400, 2, len(PHONE.nodes))), axis=0)
    sensors, seeds = Sensors([PHONE] * 2, ZONES, period_s, [4, 5]), (4, 5)
    readings = np.array([sensors.read(each) for each in nodes])
    for k, seed in enumerate(seeds):
        for column, zone in enumerate(ZONES):
            noise = stream(seed, f"zone {zone.name}").standard_normal(len(nodes))
            expected = zone.reported(PHONE.felt(zone, nodes[:, k], period_s), noise)
            assert readings[:, k, column] == pytest.approx(expected, abs=1e-9), zone.name


def test_under_a_cap_it_is_a_phone_whose_load_asks_for_that_much():
    random, caps_W, drawn_W = np.random.default_rng(3), np.where(np.arange(300) < 120, 3.0, 1.5), []
    air_degC = 20 + np.cumsum(random.normal(0, 0.1, 300))
    activity = np.repeat([PHONE.activity_index([]), PHONE.activity_index(["cpu_100"])], [1, 299])
    burst = np.append(1.0, random.uniform(0.5, 1.5, 299))
    run = Run(PHONE, float(air_degC[0]), air_degC, activity, burst, 0)
    asking_1_W = PHONE.with_values({"activities.cpu_100.heat_W.soc": 1.0})
    lesser = replace(run, device=asking_1_W, burst=np.append(1.0, caps_W[1:]))

    def control(k, nodes_degC, before_W):
        drawn_W.extend(before_W)
        return caps_W[k : k + 1]

    [driven], [free] = integrate([run], 1.0, control=control), integrate([lesser], 1.0)
    assert drawn_W == [0.0, *driven.processor_W[:-1]]
    assert driven.nodes_degC == pytest.approx(free.nodes_degC, abs=1e-9)
    assert driven.processor_W[1:] == pytest.approx(caps_W[1:])


def test_the_skin_is_the_hottest_surface_node():
    nodes = np.arange(2.0 * len(PHONE.nodes)).reshape(2, -1)
    nodes[0, PHONE.index("back")] = 50.0
    nodes[:, PHONE.index("soc")] = 90.0
    assert skin_degC(nodes).tolist() == [50.0, 11.0 + PHONE.index("frame")]
