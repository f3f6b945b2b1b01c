"""The closed loop: the skin's limit, the ambient that each governor uses, outages, and the open-loop simulation."""

from dataclasses import replace

import numpy as np
import pytest

from ambient_model.model import Secondary
from ambient_model.tracking import Tracker, nearest_discrete
from ambient_studies.mitigation.governor import FLOOR_W
from ambient_studies.mitigation.loop import closed_loop, phone_zones
from ambient_studies.mitigation.setting import Knowledge, Outage, Room, Setting
from ambient_trainer.simulator.device import load_device
from ambient_trainer.simulator.instruments import felt, zone_reading
from ambient_trainer.simulator.run import Run, integrate, stream

pytestmark = pytest.mark.slow

BRIEF = Setting(work_min=12.0, idle_min=1.0)


@pytest.fixture(scope="module")
def by_case(records):
    return {(each.case.room.name, each.case.knowledge, each.case.seed): each for each in records}


@pytest.fixture(scope="module")
def of(by_case):
    """The records of a room and a governor."""
    return lambda room, kind: [by_case[room, kind, seed] for seed in (1, 2)]


def working(record, values):
    return values[record.time_s >= 0]


def mine_and_cautious(records):
    by_knowledge = {each.case.knowledge: each for each in records}
    return by_knowledge[Knowledge.ESTIMATE], by_knowledge[Knowledge.HOTTEST]


def mean_W(record):
    return working(record, record.soc_W).mean()


@pytest.mark.parametrize("room", ["5", "35", "35/5/35"])
@pytest.mark.parametrize("kind", [Knowledge.TRUTH, Knowledge.HOTTEST, Knowledge.ESTIMATE])
def test_the_skin_stays_below_its_limit(of, setting, room, kind):
    for record in of(room, kind):
        assert record.skin_degC.max() < setting.limit_degC


@pytest.mark.parametrize("kind", [Knowledge.NOTHING, Knowledge.USUAL])
def test_without_a_governor_or_with_a_wrong_assumption_the_hot_room_exceeds_the_limit(of, setting, kind):
    for record in of("35", kind):
        assert (working(record, record.skin_degC) > setting.limit_degC).mean() > 0.8
        assert record.skin_degC.max() > setting.limit_degC + 1


def test_the_estimate_allows_more_work_than_the_hottest_assumption(of):
    for room, least_W in (("5", 1.0), ("35/5/35", 0.3)):
        for cautious, mine, free in zip(
            *(of(room, kind) for kind in (Knowledge.HOTTEST, Knowledge.ESTIMATE, Knowledge.NOTHING))
        ):
            assert mean_W(mine) > mean_W(cautious) + least_W
            assert mean_W(mine) <= mean_W(free) + 1e-9
    for mine, free in zip(of("5", Knowledge.ESTIMATE), of("5", Knowledge.NOTHING)):
        assert np.array_equal(mine.skin_degC, free.skin_degC)


def test_the_estimate_is_never_far_behind_the_truth(of):
    for room, most_W in (("5", 1e-9), ("35", 0.4), ("35/5/35", 0.3)):
        for mine, best in zip(of(room, Knowledge.ESTIMATE), of(room, Knowledge.TRUTH)):
            assert abs(mean_W(mine) - mean_W(best)) <= most_W


def test_a_held_phone_settles_at_its_fixed_trip(records, of, identified, setting):
    """At an assumed 35 degC the governor holds the die at the temperature that predicts the target."""
    record = of("5", Knowledge.HOTTEST)[0]
    late = slice(-75, None)
    trip_degC = identified.trip_degC(setting.limit_degC, setting.hottest_degC)
    # from the die's power and the phone's conductances, not from the governor
    phone = load_device()
    loss_W_K = phone.conductance_W_K["soc-board1"] + phone.conductance_W_K["soc-display"]
    die_above_surroundings_K = record.soc_W[late].mean() / loss_W_K
    assert 0 < trip_degC - die_above_surroundings_K - record.skin_degC[late].mean() < 12


def test_each_governor_uses_the_ambient_of_its_row(of, setting):
    for room in ("5", "35", "35/5/35"):
        assert (of(room, Knowledge.HOTTEST)[0].used_degC == setting.hottest_degC).all()
        assert (of(room, Knowledge.USUAL)[0].used_degC == setting.usual_degC).all()
        truth = of(room, Knowledge.TRUTH)[0]
        assert np.array_equal(truth.used_degC, truth.air_degC)
        assert np.isnan(of(room, Knowledge.NOTHING)[0].used_degC).all()
        mine = of(room, Knowledge.ESTIMATE)[0]
        assert working(mine, mine.trusted).all()
        assert np.array_equal(working(mine, mine.used_degC), working(mine, mine.estimate_degC))
        for kind in (Knowledge.NOTHING, Knowledge.HOTTEST, Knowledge.USUAL, Knowledge.TRUTH):
            assert np.isnan(of(room, kind)[0].estimate_degC).all()


def test_all_governors_of_a_seed_meet_the_same_weather(by_case):
    for room in ("5", "35", "35/5/35"):
        airs = [by_case[room, kind, 1].air_degC for kind in Knowledge]
        assert all(np.array_equal(airs[0], each) for each in airs)
        assert not np.array_equal(airs[0], by_case[room, Knowledge.TRUTH, 2].air_degC)


def test_the_estimate_is_the_devices_recursion_on_the_open_loop_simulation(of, model, setting):
    """In the cold nothing is capped: the same readings come from the simulation that knows no loop."""
    record = of("5", Knowledge.ESTIMATE)[0]
    count = len(record.time_s)
    phone = load_device()
    activity = np.where(record.time_s < 0, phone.activity_index([]), phone.activity_index(["cpu_100"]))
    run = Run(phone, float(record.air_degC[0]), record.air_degC, activity, np.ones(count), 0)
    driven = integrate([run], setting.period_s)[0]
    zones = phone_zones(model, "soc")
    columns = [
        zone_reading(zone, felt(zone, run.device, driven.nodes_degC, setting.period_s), stream(1, f"zone {zone.name}"))
        for zone in zones
    ]
    tracker = Tracker(model.main, nearest_discrete(model.main, setting.period_s))
    estimates = [tracker.update(k * setting.period_s, list(row)).ambient_degC for k, row in enumerate(zip(*columns))]
    assert [zone.name for zone in zones] == [each.name for each in model.main.inputs]
    assert record.estimate_degC == pytest.approx(np.array(estimates), abs=1e-6)


@pytest.mark.parametrize(("secondary_degC", "used_degC"), [(18.5, 17.0), (20.0, 18.5), (14.0, 15.5), (25.0, 25.0)])
def test_the_secondary_estimator_is_blended_as_on_a_device(constant, identified, secondary_degC, used_degC):
    """Up to 2 degC apart the main estimator is used, 3 degC apart half of each, from 4 degC on the secondary one."""
    model = constant(17.0)._replace(secondary=Secondary(constant(secondary_degC).main, 2.0))
    records = closed_loop(model, identified, replace(BRIEF, work_min=2.0), [Room((20.0,))], [1])
    [mine] = [each for each in records if each.case.knowledge is Knowledge.ESTIMATE]
    assert mine.trusted.all()
    assert mine.estimate_degC == pytest.approx(np.full(len(mine.time_s), used_degC))
    assert np.array_equal(mine.used_degC, mine.estimate_degC)


def test_what_still_warms_up_is_not_trusted(model, identified):
    records = closed_loop(model, identified, BRIEF, [Room((35.0,))], [1])
    mine, cautious = mine_and_cautious(records)
    assert np.isfinite(mine.estimate_degC).all()
    assert not mine.trusted.any()
    assert np.array_equal(mine.soc_W, cautious.soc_W)


def test_a_faulted_estimate_is_the_hottest_room(constant, identified):
    """30 s after its sensor is lost the estimate of 17 degC is replaced by the hottest room, until it returns."""
    setting = replace(BRIEF, outage=Outage("usb", 5.0, 11.0))
    records = closed_loop(constant(17.0), identified, setting, [Room((35.0,))], [1])
    mine, cautious = mine_and_cautious(records)
    out = (mine.time_s >= 300 + 31) & (mine.time_s < 660)
    assert np.isnan(mine.estimate_degC[out]).all()
    assert (mine.used_degC[out] == setting.hottest_degC).all()
    assert (mine.used_degC[~out & (mine.time_s < 300 + 30)] == 17.0).all()
    assert (mine.used_degC[mine.time_s >= 660] == 17.0).all()
    trusted_time, cautious_time = (mine.time_s > 200) & (mine.time_s < 300), (mine.time_s > 600) & out
    assert mine.soc_W[trusted_time].min() > cautious.soc_W[trusted_time].max() + 0.3
    assert np.abs(mine.soc_W - cautious.soc_W)[cautious_time].max() < 0.3
    assert mine.skin_degC[cautious_time].max() < setting.limit_degC


def test_a_governor_without_its_own_sensor_leaves_the_floor(constant, identified):
    setting = replace(BRIEF, outage=Outage("soc", 2.0, 4.0))
    for record in closed_loop(constant(17.0), identified, setting, [Room((35.0,))], [1]):
        # a die above 90 degC takes a moment to leave the protection's reach
        out = (record.time_s >= 130) & (record.time_s < 240)
        if record.case.knowledge is Knowledge.NOTHING:
            assert record.soc_W[out].min() > 2
        else:
            assert record.soc_W[out] == pytest.approx(np.full(out.sum(), FLOOR_W))
            assert record.soc_W[record.time_s == 241] > FLOOR_W + 0.3


def test_streaming_comes_in_bursts(constant, identified):
    setting = replace(BRIEF, workload="streaming")
    record = closed_loop(constant(17.0), identified, setting, [Room((5.0,))], [1])[0]
    assert working(record, record.soc_W).std() > 0.3
    assert record.soc_W[record.time_s < 0].std() < 0.01


def test_without_idle_time_it_starts_in_steady_state(constant, identified):
    """The work begins at 0 s; the phone was off it before."""
    record = closed_loop(constant(17.0), identified, replace(BRIEF, idle_min=0.0), [Room((20.0,))], [1])[0]
    assert record.time_s[:2].tolist() == [-1.0, 0.0]
    assert record.soc_W[0] == pytest.approx(0.24, abs=0.01)
    assert record.skin_degC[0] < 21.5
