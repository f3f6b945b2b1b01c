"""The stepped phone against the open-loop simulation, and under a cap against an adaptive solver."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from ambient_studies.mitigation.plant import Plant, skin_degC
from ambient_trainer.simulator.device import load_device
from ambient_trainer.simulator.heat import Demand, HeatBalance
from ambient_trainer.simulator.instruments import felt, zone_reading
from ambient_trainer.simulator.run import Run, integrate, stream

PHONE = load_device()
SOC = PHONE.index("soc")
ZONES = [PHONE.zone(name) for name in ("soc", "flash", "usb", "msm-skin", "pm8350", "battery-cell")]


def run_of(seed, *steps, phone=None):
    """(activity, samples) after each other in wandering air."""
    random = np.random.default_rng(seed)
    activity = np.concatenate([np.full(count, PHONE.activity_index([each])) for each, count in steps])
    air_degC = 20 + np.cumsum(random.normal(0, 0.1, len(activity)))
    burst = random.uniform(0.5, 1.5, len(activity))
    return Run(phone or PHONE, float(air_degC[0]), air_degC, activity, burst, 0)


def stepped(plant, count, cap_W):
    nodes, readings, drawn_W = [], [], []
    for k in range(count):
        nodes.append(plant.nodes_degC)
        readings.append(plant.readings_degC)
        drawn_W.append(plant.drawn_W(cap_W))
        if k + 1 < count:
            plant.step(cap_W)
    return np.array(nodes), np.array(readings), np.array(drawn_W)


@pytest.mark.parametrize("period_s", [0.5, 1.0, 5.0])
def test_without_a_cap_it_is_the_open_loop_simulation(period_s):
    steps = [("idle", 40), ("cpu_100", 200), ("charging", 60), ("streaming", 100)]
    runs, seeds = [run_of(1, *steps), run_of(2, *reversed(steps))], [4, 5]
    nodes, readings, drawn_W = stepped(Plant(runs, seeds, ZONES, period_s), 400, np.full(2, np.inf))
    for k, (driven, seed) in enumerate(zip(integrate(runs, period_s), seeds)):
        assert nodes[:, k] == pytest.approx(driven.nodes_degC, abs=1e-10)
        assert drawn_W[:, k] == pytest.approx(driven.processor_W, abs=1e-10)
        assert driven.nodes_degC[:, SOC].max() > 85  # the die's own protection was near
        for column, zone in enumerate(ZONES):
            temp = felt(zone, PHONE, driven.nodes_degC, period_s)
            expected = zone_reading(zone, temp, stream(seed, f"zone {zone.name}"))
            assert readings[:, k, column] == pytest.approx(expected, abs=1e-9), zone.name


def test_under_a_cap_it_agrees_with_an_adaptive_solver():
    run = run_of(3, ("cpu_100", 300))
    caps_W = np.where(np.arange(300) < 120, 3.0, 1.5)
    plant, balance = Plant([run], [1], ZONES, 1.0), HeatBalance([run.device])
    state = plant.nodes_degC[0]
    for k in range(299):
        heat_W = balance.demand(run.activity[k : k + 1], run.burst[k : k + 1]).heat_W
        heat_W[0, SOC] = min(heat_W[0, SOC], caps_W[k])

        def rates(t, nodes, heat_W=heat_W, k=k):
            air = run.air_degC[k] + (run.air_degC[k + 1] - run.air_degC[k]) * t
            return balance.rates(nodes[None], np.array([air]), Demand(heat_W, np.zeros(1)))[0]

        state = solve_ivp(rates, (0, 1), state, method="DOP853", rtol=1e-10, atol=1e-10).y[:, -1]
        plant.step(caps_W[k : k + 1])
        assert plant.nodes_degC[0] == pytest.approx(state, abs=5e-4)
    assert plant.drawn_W(np.array([1.5])) == pytest.approx([1.5])


def test_the_skin_is_the_hottest_surface_node():
    nodes = np.arange(2.0 * len(PHONE.nodes)).reshape(2, -1)
    nodes[0, PHONE.index("back")] = 50.0
    nodes[:, SOC] = 90.0
    assert skin_degC(nodes).tolist() == [50.0, 11.0 + PHONE.index("frame")]
