"""The closed loop: the skin's limit, the ambient that each governor uses, outages, the open loop, the command."""

from dataclasses import replace

import numpy as np
import pytest

from ambient_model.model import Model, Secondary
from ambient_model.tracking import Tracker, nearest_discrete
from ambient_studies.mitigation.comparison import identify, settling_min, training_trace
from ambient_studies.mitigation.governor import Identified
from ambient_studies.mitigation.loop import closed_loop, phone_zones
from ambient_studies.mitigation.setting import Knowledge, Outage, Room, Setting
from ambient_trainer.estimators.base import Effort
from ambient_trainer.estimators.library.free import FreeFilterEstimator
from ambient_trainer.estimators.model_file import model_of
from ambient_trainer.simulator import load_device, simulate
from ambient_trainer.simulator.run import Run, integrate, stream

from .sample_report import constant_model

pytestmark = pytest.mark.slow

COLD, HOT, WALK = Room((5.0,)), Room((35.0,)), Room((35.0, 5.0, 35.0))


@pytest.fixture(scope="session")
def identified() -> Identified:
    return identify(training_trace(load_device().zone("soc")))


@pytest.fixture(scope="session")
def model() -> Model:
    """As ``ambient-trainer simulate 5`` and ``fit --circuit free-2`` make it."""
    return model_of(FreeFilterEstimator(2).fit([simulate("5").trace], Effort(starts=3)), [], {})


@pytest.fixture(scope="session")
def setting(model: Model) -> Setting:
    return Setting(work_min=36.0, idle_min=settling_min(model, 4.0), period_s=4.0)


BRIEF = Setting(work_min=12.0, idle_min=1.0)


@pytest.fixture(scope="module")
def of(model: Model, identified: Identified, setting: Setting):
    """The records of a room and a governor: two seeds in a cold and a hot one, and from this to that and back."""
    records = closed_loop(model, identified, setting, [COLD, HOT, WALK], [1, 2])
    by_case = {(each.case.room.name, each.case.knowledge, each.case.seed): each for each in records}
    return lambda room, kind: [by_case[room, kind, seed] for seed in (1, 2)]


def working(record, values):
    return values[record.time_s >= 0]


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


def test_the_estimate_is_the_devices_recursion_on_the_open_loop_simulation(of, model, setting):
    """In the cold nothing is capped: the same readings come from the simulation that knows no loop."""
    record = of("5", Knowledge.ESTIMATE)[0]
    count = len(record.time_s)
    phone = load_device()
    activity = np.where(record.time_s < 0, phone.activity_index([]), phone.activity_index(["cpu_100"]))
    run = Run(phone, float(record.air_degC[0]), record.air_degC, activity, np.ones(count), 0)
    driven = integrate([run], setting.period_s)[0]
    zones = phone_zones(model, "soc")
    noises = [stream(1, f"zone {zone.name}").standard_normal(count) for zone in zones]
    felt = [phone.felt(zone, driven.nodes_degC, setting.period_s) for zone in zones]
    columns = [zone.reported(*each) for zone, each in zip(zones, zip(felt, noises))]
    tracker = Tracker(model.main, nearest_discrete(model.main, setting.period_s))
    estimates = [tracker.update(k * setting.period_s, list(row)).ambient_degC for k, row in enumerate(zip(*columns))]
    assert [zone.name for zone in zones] == [each.name for each in model.main.inputs]
    assert record.estimate_degC == pytest.approx(np.array(estimates), abs=1e-6)


@pytest.mark.parametrize(("secondary_degC", "used_degC"), [(18.5, 17.0), (20.0, 18.5), (14.0, 15.5), (25.0, 25.0)])
def test_the_secondary_estimator_is_blended_as_on_a_device(identified, secondary_degC, used_degC):
    """Up to 2 degC apart the main estimator is used, 3 degC apart half of each, from 4 degC on the secondary one."""
    model = constant_model(17.0)._replace(secondary=Secondary(constant_model(secondary_degC).main, 2.0))
    records = closed_loop(model, identified, replace(BRIEF, work_min=2.0), [Room((20.0,))], [1])
    [mine] = [each for each in records if each.case.knowledge is Knowledge.ESTIMATE]
    assert mine.trusted.all()
    assert mine.estimate_degC == pytest.approx(np.full(len(mine.time_s), used_degC))
    assert np.array_equal(mine.used_degC, mine.estimate_degC)


def test_a_faulted_estimate_is_the_hottest_room(identified):
    """30 s after its sensor is lost the estimate of 17 degC is replaced by the hottest room, until it returns."""
    setting = replace(BRIEF, outage=Outage("usb", 5.0, 11.0))
    records = closed_loop(constant_model(17.0), identified, setting, [Room((35.0,))], [1])
    by_knowledge = {each.case.knowledge: each for each in records}
    mine, cautious = by_knowledge[Knowledge.ESTIMATE], by_knowledge[Knowledge.HOTTEST]
    out = (mine.time_s >= 300 + 31) & (mine.time_s < 660)
    assert np.isnan(mine.estimate_degC[out]).all()
    assert (mine.used_degC[out] == setting.hottest_degC).all()
    assert (mine.used_degC[~out & (mine.time_s < 300 + 30)] == 17.0).all()
    assert (mine.used_degC[mine.time_s >= 660] == 17.0).all()
    trusted_time, cautious_time = (mine.time_s > 200) & (mine.time_s < 300), (mine.time_s > 600) & out
    assert mine.soc_W[trusted_time].min() > cautious.soc_W[trusted_time].max() + 0.3
    assert np.abs(mine.soc_W - cautious.soc_W)[cautious_time].max() < 0.3
    assert mine.skin_degC[cautious_time].max() < setting.limit_degC


def test_it_prints_writes_and_draws(figures, saved, model, tmp_path):
    report = tmp_path / "report"
    options = ("--room", "5", "--room", "35", "--runs", 1, "--minutes", 20, "--report", report)
    found, out = figures("mitigate", saved(model), *options)
    lines = out.splitlines()
    assert "0.126 soc" in out
    assert "soc at 61 degC, 20 degC at 166 degC (" in out
    assert lines[-2:] == [f"Figures: {tmp_path}/figures.json", f"Report: {report}/index.html"]
    assert found["simulated"] is True
    assert found["model"] == "free-2"
    assert found["seeds"] == [1]
    assert lines[-4:-2] == found["verdict"]
    rows = {(each["room"], each["told"]): each for each in found["rows"]}
    assert len(rows) == 10
    assert rows["5", "ESTIMATE"]["trusted_frac"] == 1.0
    assert rows["5", "ESTIMATE"]["work_frac"] > rows["5", "HOTTEST"]["work_frac"] + 0.2
    assert rows["35", "USUAL"]["above_limit_min"] > 10
    assert rows["35", "ESTIMATE"]["max_skin_degC"] < found["setting"]["limit_degC"]
    assert found["governor"]["rest_gains"].keys() == {"soc", "ambient"}
    for row in found["rows"]:
        assert f"{row['max_skin_degC']:.1f}" in out
    assert (report / "index.html").stat().st_size > 100_000
