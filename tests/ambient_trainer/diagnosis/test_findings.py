"""What is said of mechanisms: which rivals count, which size is shown, and what may be called none."""

from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from ambient_trainer.api.diagnosing import DiagnosisResult
from ambient_trainer.diagnosis.diagnose import _has_large_misfit
from ambient_trainer.diagnosis.figures import driving
from ambient_trainer.diagnosis.findings import _confidence, _is_rival, _numbers
from ambient_trainer.diagnosis.greybox.choice import SelectionStep
from ambient_trainer.diagnosis.greybox.expression import Expression
from ambient_trainer.diagnosis.greybox.mechanisms.coupling import ZoneLoss
from ambient_trainer.diagnosis.greybox.mechanisms.heat import Heat
from ambient_trainer.diagnosis.greybox.mechanisms.mass import HiddenMass
from ambient_trainer.diagnosis.greybox.mechanisms.sensor import Bias, Clock, Lag
from ambient_trainer.diagnosis.greybox.model import GreyBox, Mechanism, Number
from ambient_trainer.diagnosis.greybox.trials import Trial
from ambient_trainer.diagnosis.later import Later
from ambient_trainer.diagnosis.result import Cause


def heat(driver: str | None, **amounts: tuple[float, float]) -> Heat:
    """Amounts by place, each with the scale of its coordinate."""
    numbers = tuple(Number(f"heat_{each}", "W", value, scale=scale) for each, (value, scale) in amounts.items())
    return Heat(tuple(amounts), numbers, None if driver is None else Expression(driver))


def test_the_size_shown_is_that_of_the_largest_amount_and_not_of_the_finest_scale():
    mechanism = heat("load_frac", coil=(40.0, 20.0), controller=(5.0, 0.1))
    free = SimpleNamespace(parameters=(), sources=(), states=(), edges=())
    final = SimpleNamespace(model=GreyBox(free, (), (mechanism,)), covariance=np.eye(2))
    magnitude, _ = _numbers(final, 0)
    assert (magnitude.value, magnitude.meaning, magnitude.qualifier[:12]) == (40.0, "heat into coil", "on the scale")


def logged(period_s: float = 1.0, **columns: np.ndarray) -> list[SimpleNamespace]:
    """A record of these columns."""
    samples = len(next(iter(columns.values())))
    time_s = period_s * np.arange(samples)
    return [SimpleNamespace(signals=columns, period_s=period_s, samples=samples, time_s=time_s, known_good=False)]


def tried(mechanism: Mechanism, records: Sequence[SimpleNamespace] = (), rmse_degC: float = 0.5) -> Trial:
    return Trial(mechanism, SimpleNamespace(records=records), rmse_degC, at_bounds=False)


def sure(chosen: Trial, *others: Trial, also: Sequence[Trial] = ()) -> float:
    """The confidence in a trial beside others, where the final model holds it, and what else it holds."""
    model = SimpleNamespace(mechanisms=[each.mechanism for each in (chosen, *also)])
    before = SimpleNamespace(held_out_rmse_degC=2.0, model=SimpleNamespace(mechanisms=model.mechanisms[1:]))
    step = SelectionStep(before, chosen, (chosen, *others), 1)
    return _confidence(step, chosen, SimpleNamespace(model=model, records=chosen.fitted.records))


def test_who_is_a_rival_another_driver_unless_it_is_there_too_or_goes_along_all_the_time():
    random = np.random.default_rng(3)
    lamp = random.uniform(500, 900, 200)
    records = logged(lamp_lux=lamp, twin_lux=1.1 * lamp + random.normal(0, 20, 200), load_frac=random.random(200))

    def trial(driver: str, **further: tuple[float, float]) -> Trial:
        return tried(heat(driver, board=(1, 1), **further), records)

    chosen, load = trial("lamp_lux"), trial("load_frac")
    alike = [trial("lamp_lux^2"), trial("lamp_lux", lid=(1, 1)), trial("twin_lux")]
    assert sure(chosen, *alike) > 0.9
    assert sure(chosen, *alike, load) < 0.5
    assert sure(chosen, *alike, load, also=[load]) > 0.9
    rivals = [each.mechanism.driver.text for each in (*alike, load) if _is_rival(each, chosen)]
    assert rivals == ["lamp_lux^2", "twin_lux"]


@pytest.mark.parametrize(("beside", "doubted"), [("current_A", True), ("air_hPa", False)])
def test_heat_by_a_speed_is_not_sure_where_a_current_is_logged(beside, doubted):
    records = logged(**{name: np.random.default_rng().random(200) for name in ("motor_rpm", beside)})
    assert (sure(tried(heat("motor_rpm", board=(1, 1)), records)) < 0.61) == doubted


@pytest.mark.parametrize("heated", ["board", "lid"])
def test_a_sensor_that_lags_where_something_logged_heats_may_be_the_heaters_own_body(heated):
    network = SimpleNamespace(sensors=("top",), nodes=["lid", "board"], reads=np.array([1]))
    lag = Lag(("top",), (Number("lag", "s", 40.0),))
    model = SimpleNamespace(mechanisms=(heat("load_frac", **{heated: (1, 1)}), lag), z=lambda: np.zeros(2))
    model.network = lambda record, z: network
    chosen = sure(Trial(lag, SimpleNamespace(model=model, records=[None]), 0.2, False))
    assert chosen < 0.61 if heated == "board" else chosen > 0.9


@pytest.mark.parametrize("by_day", [True, False])
def test_a_clock_that_is_off_may_be_heat_by_day_where_the_ambient_is_warm_by_day(by_day):
    """A bare thermometer in a pond, measured: the sun warms it before the water, as if its clock were ahead."""
    draw = np.random.default_rng()
    row = np.sin(np.arange(600) * 2 * np.pi / 144) if by_day else np.cumsum(draw.exponential(size=600))
    clock = Clock((), (Number("clock", "s", 2000.0),))
    chosen = sure(tried(clock, logged(600.0, ambient_degC=row), 0.2))
    assert chosen < 0.61 if by_day else chosen > 0.9


@pytest.mark.parametrize(
    ("driver", "off_s", "onset_s", "lasts_s", "told"),
    [
        *(("heater_on", *each) for each in ((150, 55, 90, True), (150, 10, 90, False), (900, 58, 40, True))),
        *(("delay(heater_on, 40)", 900, each, 40, 50 < each < 90) for each in (70, 100, 30)),
    ],
)
def test_a_window_is_no_rival_of_the_logged_heater_that_acts_or_was_switched_on_then(
    driver, off_s, onset_s, lasts_s, told
):
    """The window of a long step is over when the heater is still on, and one that acts late was switched on before."""
    time_s = np.arange(400.0)
    chosen = tried(heat(driver, board=(1, 1)), logged(heater_on=1.0 * ((time_s > 50) & (time_s < off_s))))
    window = replace(heat(None, board=(1, 1)), onset_s=onset_s, end_s=onset_s + lasts_s)
    assert (sure(chosen, replace(chosen, mechanism=window, rmse_degC=0.3)) > 0.9) == told


def test_what_a_window_that_stands_for_the_heater_has_beaten_is_no_rival_of_the_heater():
    """A heater whose body is still missing: its window does better, and so would a sensor that is off for as long."""
    time_s = np.arange(400.0)
    chosen = tried(heat("heater_on", board=(1, 1)), logged(heater_on=1.0 * ((time_s > 50) & (time_s < 150))))
    there, apart = {"onset_s": 55, "end_s": 145}, {"onset_s": 250, "end_s": 340}
    off = replace(chosen, mechanism=Bias(("lid",), (Number("bias_lid", "degC", 1.0),), **there), rmse_degC=0.3)

    def beside(when: dict[str, int]) -> float:
        return sure(chosen, replace(chosen, mechanism=replace(heat(None, board=(1, 1)), **when), rmse_degC=0.1), off)

    assert beside(there) > 0.9
    assert beside(apart) < 0.1


def test_the_rest_of_what_is_there_is_no_rival():
    """Heat at the second place by a driver of heat at the first, if the final model holds it at both."""
    records = logged(one_frac=np.random.default_rng(1).random(200), other_frac=np.random.default_rng(2).random(200))
    chosen, first = tried(heat("other_frac", lid=(1, 1)), records), heat("one_frac", board=(1, 1))
    rest = tried(heat("one_frac", lid=(1, 1)), records, 0.45)
    before = SimpleNamespace(held_out_rmse_degC=2.0, model=SimpleNamespace(mechanisms=[first]))
    for held, told in ((heat("one_frac", board=(1, 1), lid=(1, 1)), True), (first, False)):
        final = SimpleNamespace(model=SimpleNamespace(mechanisms=[chosen.mechanism, held]), records=records)
        assert (_confidence(SelectionStep(before, chosen, (rest, chosen), 1), chosen, final) > 0.9) == told


BODY = Number("G_board_mass", "W/K", 1.0, log=True), Number("lag_board_mass", "s", 9.0, log=True)
ZONE = ZoneLoss(("board",), (Number("change_board", "1", 1.0),), Expression("ambient_degC > 20"))
DOUBTED = heat(None, board=(1, 1)), heat("d(heater_frac)/dt", board=(1, 1)), HiddenMass(("board",), BODY), ZONE


@pytest.mark.parametrize("mechanism", DOUBTED, ids=str)
def test_what_may_be_something_quite_different_is_half_sure(mechanism):
    """In a record whose ambient rests."""
    records = logged(ambient_degC=np.full(200, 21.0), heater_frac=np.ones(200))
    assert 0.5 < sure(tried(mechanism, records, 0.2)) < 0.61


def test_constant_heat_is_not_told_from_an_offset_of_its_sensor():
    chosen, offset = tried(heat(None, lid=(1, 1))), tried(Bias(("lid",), (Number("bias_lid", "degC", 1.0),)))
    assert sure(chosen) > 0.9
    assert sure(chosen, offset) < 0.6
    assert _is_rival(offset, chosen)


@pytest.mark.parametrize(
    ("onset_s", "lag_s", "unit"), [(None, 2e4, None), (None, 500.0, "J/K"), (60.0, 500.0, "J/K"), (60.0, 2e3, "J/K")]
)
def test_a_mass_slower_than_the_record_has_no_heat_capacity_and_may_be_another_room(onset_s, lag_s, unit):
    high = 30 * 1e4 if onset_s is None else 1e4 / 3  # of a record of 1e4 s
    numbers = (Number("G_case_mass", "W/K", 1.0, log=True), Number("lag_case_mass", "s", lag_s, log=True, high=high))
    mass = HiddenMass(("case",), numbers, onset_s=onset_s)
    assert ((mass.product() or ("", None))[1], "slower than the record" in mass.sentence_tail()) == (unit, unit is None)
    loaded = logged(ambient_degC=np.full(200, 21.0), heater_frac=np.arange(200.0))
    assert onset_s is not None or (sure(tried(mass, loaded, 0.2)) < 0.61) == (unit is None)


def test_a_large_smooth_misfit_is_no_none_although_a_black_box_leaves_as_much():
    def misfits(residual: np.ndarray) -> bool:
        record = SimpleNamespace(sensors=np.linspace(20, 30, residual.size)[None])
        rmse = float(np.sqrt(np.mean(residual**2)))
        bare = SimpleNamespace(
            records=[record], residual_degC=lambda index: residual[None], held_out_rmse_degC=rmse, rmse_degC=rmse
        )
        return _has_large_misfit(bare, floor_degC=rmse)

    time = np.arange(500)
    assert misfits(0.6 * np.sin(time / 40))
    assert not misfits(0.45 * np.random.default_rng(1).standard_normal(500))
    assert not misfits(0.1 * np.sin(time / 40))


def test_the_panel_of_a_delayed_driver_is_that_of_its_column(made):
    step = replace(made().steps[0], cause=Cause("heat_source", "flash", "delay(camera_on, 420)"))
    assert driving(made(steps=(step,))) == ["camera_on"]


def test_a_finding_that_makes_later_time_worse_says_so(made):
    def second_line(extended_rmse_degC: float) -> str:
        return DiagnosisResult(made(), Later(900.0, 2.0, extended_rmse_degC, 100)).summary.lead[1].text

    assert "worse" in second_line(2.5)
    assert "worse" not in second_line(0.5)
