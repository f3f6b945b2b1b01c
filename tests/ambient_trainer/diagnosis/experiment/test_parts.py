"""The library of plans, the simulation of many at once, and the words for one."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from ambient_trainer.diagnosis.experiment.difference import Difference
from ambient_trainer.diagnosis.experiment.plan import Bench, Drive, Intervention, Plan, Switch, bench_of, plans
from ambient_trainer.diagnosis.experiment.sentence import Wording
from ambient_trainer.diagnosis.experiment.simulate import Course, predicted
from ambient_trainer.diagnosis.model import Effect, Model
from ambient_trainer.diagnosis.plant import Plant
from ambient_trainer.diagnosis.result import Cause
from ambient_trainer.diagnosis.selection import Selection


@pytest.mark.parametrize(
    ("low", "high", "drive"),
    [
        (0.4, 3.0, Drive("power_W", 0.4, (3.0,))),
        (-1.0, 2.0, Drive("power_W", 0.0, (2.0, -1.0))),
        (-2.0, -0.5, Drive("power_W", -0.5, (-2.0,))),
        (1.0, 1.0, Drive("power_W", 1.0, ())),
    ],
)
def test_a_drive_rests_where_it_does_least(
    single: Plant, chosen: Callable[..., Selection], low: float, high: float, drive: Drive
) -> None:
    seen = chosen(single, 0.1).plain.views[0]
    row = np.where(np.arange(seen.record.samples) % 2, low, high)
    power = single.circuit.inputs.index("power_W")
    inputs = np.array([row if index == power else each for index, each in enumerate(seen.record.inputs)])

    bench = bench_of([replace(seen, record=replace(seen.record, inputs=inputs))], [])

    assert bench.drives == (drive,)
    assert bench.temperatures_degC == {"ambient_degC": 20.0}
    warmest = max(drive.levels, default=drive.rest)
    assert bench.heater == (("power_W", warmest) if warmest > drive.rest else None)


BENCH = Bench({"ambient_degC": 20.0}, (Drive("power_W", 0.0, (2.0,)), Drive("radio_on", 0.0, (1.0,))), ("power_W", 2.0))


@pytest.mark.parametrize("intervention", list(Intervention))
def test_plans_are_all_different_and_the_simplest_comes_first(intervention: Intervention) -> None:
    found = plans(BENCH, intervention)

    assert found[0] == Plan(())
    assert len(set(found)) == len(found)
    assert [each.acts for each in found] == sorted(each.acts for each in found)
    assert any(each.again_s is not None for each in found) == (intervention is not Intervention.LEFT)
    assert any(each.undone for each in found) == (intervention is Intervention.UNDONE)


def test_a_plan_switches_in_time() -> None:
    plan = Plan((Switch("power_W", 0.0, 2.0), Switch("power_W", 60.0, 0.0)), again_s=30.0)
    time_s = np.array([-30.0, 0.0, 30.0, 60.0])

    columns = plan.columns(BENCH, time_s)

    assert columns["power_W"].tolist() == [0, 2, 2, 0]
    assert columns["ambient_degC"].tolist() == [20, 20, 20, 20]
    assert plan.happens(time_s).tolist() == [0, 0, 1, 1]  # type: ignore[union-attr]


def test_a_loss_far_from_straight_is_simulated_as_a_fine_integration_does(
    single: Plant, effect: Callable[..., Effect]
) -> None:
    """100 x' = P - (x + 0.3 x |x|) / 10 above the ambient, with the power on for half of the time."""
    curved = effect(single, Cause("convection_law"), (0.3, 0.0))
    time_s = 20.0 * np.arange(-1, 301)
    power = np.where((time_s >= 0) & (time_s < 3000), 6.0, 0.0)
    course = Course({"ambient_degC": np.full(302, 15.0), "power_W": power}, None)

    found = predicted(Model(single, (curved,)), None, [course], time_s, 0.0)

    def slope(t: float, x: np.ndarray, heat_W: float) -> np.ndarray:
        return (heat_W - (x + 0.3 * x * np.abs(x)) / 10.0) / 100.0

    on = solve_ivp(slope, (0, 3000), [0.0], "DOP853", time_s[1:152], args=(6.0,), rtol=1e-10, atol=1e-10).y[0]
    off = solve_ivp(slope, (3000, 6000), on[-1:], "DOP853", time_s[151:], args=(0.0,), rtol=1e-10, atol=1e-10).y[0]
    np.testing.assert_allclose(found.readings_degC[0, 0], 15.0 + np.concatenate([[0.0], on, off[1:]]), atol=0.05)


def test_what_runs_away_is_no_number_and_no_failure(single: Plant, effect: Callable[..., Effect]) -> None:
    """A loss that turns into a gain 2 degC above the room: 6 W run away, and the plan beside it stays as it is."""
    bent = effect(single, Cause("convection_law"), (-0.5, 0.0))
    time_s = 20.0 * np.arange(-1, 301)
    courses = [
        Course({"ambient_degC": np.full(302, 20.0), "power_W": np.where(time_s >= 0, power, 0.0)}, None)
        for power in (6.0, 0.0)
    ]

    away, calm = predicted(Model(single, (bent,)), None, courses, time_s, 0.0).readings_degC[:, 0]

    assert away[0] == pytest.approx(20.0)
    assert not np.abs(away[-1]) < 1e3
    np.testing.assert_allclose(calm, 20.0)


def test_what_comes_after_the_reading_is_not_asked_for() -> None:
    plan = Plan((Switch("power_W", 0.0, 2.0), Switch("power_W", 1200.0, 0.0)))
    words = Wording(("one", "other"), BENCH, ("board",), None)
    found = Difference(plan, 0, False, 1150.0, 1200.0, (30.0, 28.0), 1.5)

    short = words.distinguished(found)
    long = words.distinguished(replace(found, reading_s=4800.0))

    start = (
        "Hold `ambient_degC` at 20 degC, `power_W` at 0 W and `radio_on` at 0 until all readings stand still,"
        " then take `power_W` from 0 to 2 W"
    )
    end = "`board` reads 30.00 degC if one, and 28.00 degC if other (3 sigma is 1.5 degC)."
    assert short == f"{start}: after 20 min {end}"
    assert long == f"{start} and 20 min later take `power_W` back to 0 W: after 1 h 20 min {end}"
    assert f": 20 min before the reference shows it {end}" in words.distinguished(replace(found, reading_s=-1200.0))
