"""Sensor validation: expectations against Gaussian conditioning by numpy, and the rules by which readings count."""

import re

import numpy as np
import pytest

from ambient_model.codec import decode, encode
from ambient_model.conformance import conformance_of
from ambient_model.model import Discrete, Estimator, Input, Matrix, Model, ReadingModel, SensorLimits
from ambient_model.observer import Observer
from ambient_model.tracking import Tracker
from ambient_model.validation import Validation
from refusals import refused_places

LIMITS = SensorLimits(step=0.1, jump=1.0, gate=0.6, slow_gate=0.3, still_s=60.0, memory_s=60.0, effect_degC=0.2)


def precision_of(own: np.ndarray) -> Matrix:
    """Of readings and low-pass filters that follow one common temperature, each with noise of covariance ``own``."""
    precision = np.linalg.inv(100 * np.ones(own.shape) + own + 0.01 * np.eye(len(own)))
    return tuple(map(tuple, ((precision + precision.T) / 2).tolist()))


@pytest.fixture(scope="module")
def model() -> Model:
    """It averages the sensors."""
    inputs = tuple(Input(name, "degC", name, -45.0, 130.0) for name in ("usb", "battery", "display", "shell"))
    discrete = Discrete(1.0, (), (), ((),), ((0.25,) * 4,))
    main = Estimator(inputs, (), (discrete,), 0.0, (), {50: (-0.1, 0.1), 90: (-0.3, 0.3), 98: (-0.5, 0.5)})
    noise = np.random.default_rng(3).normal(size=(8, 8)) * 0.05
    readings = ReadingModel(
        lags_s=(60.0,),
        mean=(25.0,) * 8,
        precision=precision_of(noise @ noise.T),
        sensors=(LIMITS,) * 4,
        jump_s=1.0,
        settled_s=0.0,
        output=(-20.0, 70.0),
        rate_K_per_s=5.0,
    )
    rows = tuple((20.0 + i, 21.0, 22.0, 23.0) for i in range(4))
    return Model("average", "now", "ambient", main, {}, {}, conformance_of(main, rows), readings=readings)


def observer_of(model: Model, **readings: object) -> Observer:
    """With some of the expected readings' numbers as given."""
    model = model._replace(readings=model.readings._replace(**readings))
    return Observer(model, Tracker(model.main, model.main.discrete[0]))


@pytest.fixture
def observer(model: Model) -> Observer:
    return observer_of(model)


def readings_at(k: int) -> list[float]:
    """All near one temperature that rises slowly, each with noise of a tenth."""
    return np.round(25 + k / 400 + np.random.default_rng(k).normal(size=4) * 0.05, 1).tolist()


def fed(observer: Observer, count: int, change=lambda k, u: u, start: int = 0):
    return [observer.update(float(k), change(k, readings_at(k))) for k in range(start, start + count)]


def test_a_file_keeps_the_key(model: Model) -> None:
    assert decode(encode(model).encode(), "model") == model
    assert '"readings"' not in encode(model._replace(readings=None))
    # files from before there were starts, and limits of them
    text = re.sub(r',\s*"(starts|turn|start)": (\[\]|0\.0)', "", encode(model))
    assert not re.search(r'"(turn|start)"', text)
    assert decode(text.encode(), "model") == model
    sensors = (LIMITS._replace(turn=1.5, start=7.0),) * 4
    later = model.readings._replace(sensors=sensors, offset_gains=((0.5,) * 4,) * 4, offset_std_degC=0.2)
    limited = model._replace(readings=later)
    assert decode(encode(limited).encode(), "model") == limited


@pytest.mark.parametrize(
    ("wrong", "value"),
    [
        *[("precision", ((1.0, 2.0, *(0.0,) * 6),) * 8), ("jump_s", 0.0), ("lags_s", (-1.0,))],
        *[("starts", (((0.25,) * 3,),)), ("starts", (((0.25,) * 4,),)), ("starts", ((), ()))],
        ("offset_gains", ((0.5,) * 4,) * 3),
    ],
)
def test_a_wrong_key_is_refused_by_its_place(model: Model, wrong: str, value: object) -> None:
    text = encode(model._replace(readings=model.readings._replace(**{wrong: value})))
    assert any(each.startswith(f"readings.{wrong}") for each in refused_places(decode, text.encode(), "model"))


@pytest.mark.parametrize("away", [(1,), (0, 2), (0, 1, 3)])
def test_what_replaces_missing_readings_is_their_conditional_mean(model: Model, away: tuple[int, ...]) -> None:
    validation = Validation(model.readings, model.main, 1.0)
    u = np.array([24.0, 25.5, 25.0, 26.0])
    used = validation.update(0.0, [None if i in away else float(value) for i, value in enumerate(u)])
    # at the start the low-pass filters have the readings' values
    kept = [i for i in range(8) if i % 4 not in away]
    gone = [i for i in range(8) if i % 4 in away]
    S = np.linalg.inv(np.array(model.readings.precision))
    z = np.concatenate([u, u])
    wanted = 25 + S[np.ix_(gone, kept)] @ np.linalg.solve(S[np.ix_(kept, kept)], z[kept] - 25)
    assert [used[i] for i in away] == pytest.approx(wanted[: len(away)], abs=1e-6)
    conditional = S[np.ix_(gone, gone)] - S[np.ix_(gone, kept)] @ np.linalg.solve(
        S[np.ix_(kept, kept)], S[np.ix_(kept, gone)]
    )
    first = len(away)
    assert validation.variance_degC2 >= 0.9 * 0.25**2 * conditional[:first, :first].sum()
    assert validation.is_degraded


@pytest.fixture
def loose(model: Model) -> Observer:
    """Sensors 3 degC apart from one another are as usual."""
    apart = precision_of(np.kron(np.ones((2, 2)), 9 * np.eye(4)))
    return observer_of(model, precision=apart, sensors=(LIMITS._replace(gate=9.0, slow_gate=6.0),) * 4)


@pytest.mark.parametrize("phases", [(0, 3, 6, 9), (9, 7, 1, 4)])
def test_every_sensor_at_a_tenth_of_the_rate_from_the_start(loose: Observer, phases: tuple[int, ...]) -> None:
    apart = (-3.0, 0.0, 3.0, 1.0)
    found = fed(loose, 300, lambda k, u: [u[i] + apart[i] if k % 10 == phases[i] else None for i in range(4)])
    first = min(phases)
    assert [each.status for each in found[:9]] == ["faulted"] * first + ["degraded"] * (9 - first)
    assert {each.status for each in found[9:]} == {"tracking"}
    assert max(abs(each.ambient_degC - 25.25 - k / 400) for k, each in enumerate(found[9:], start=9)) < 0.2


@pytest.mark.parametrize("value", [-40.0, 0.0, 85.0, 125.0, 0.0255, 33.0])
def test_a_lie_is_refused_until_it_ends(observer: Observer, value: float) -> None:
    fed(observer, 200)
    lied = fed(observer, 900, lambda k, u: [value, *u[1:]], start=200)
    assert {each.status for each in lied} == {"degraded"}
    assert max(abs(each.ambient_degC - 25.5 - k / 400) for k, each in enumerate(lied)) < 0.3
    after = fed(observer, 40, start=1100)
    assert after[-1].status == "tracking"
    assert [each.status for each in after].index("tracking") <= 25


@pytest.mark.parametrize("away", [(), (2,)])
def test_a_step_that_jump_and_gate_allow_is_refused_where_nothing_else_moves(loose: Observer, model, away) -> None:
    limits = LIMITS._replace(gate=9.0, slow_gate=6.0, jump=20.0, turn=1.0)
    observer = observer_of(model, precision=loose._readings.precision, sensors=(limits,) * 4)

    def step(of):
        # as if one, or all of them, read 5 K more from 700 s on
        return lambda k, u: [
            None if i in away and k == 650 else x + 5 * (k >= 700 and i in of) for i, x in enumerate(u)
        ]

    lied = fed(observer, 900, step((1,)))
    assert {each.status for each in lied[100:700]} == {"tracking"}
    assert {each.status for each in lied[700:]} == {"degraded"}
    assert list(observer.validation.refused) == [1]
    observer = observer_of(model, precision=loose._readings.precision, sensors=(limits,) * 4)
    assert {each.status for each in fed(observer, 900, step(range(4)))[100:]} == {"tracking"}


def test_no_right_reading_turns_where_a_wrong_one_and_its_past_move_its_expectation(model) -> None:
    # reading 3 is four times reading 1 less three times reading 2, and slowly follows their past
    u = np.random.default_rng(0).normal(size=(4000, 4))
    lows = np.random.default_rng(1).normal(size=(4000, 4))
    u[:, 3] = 4 * u[:, 1] - 3 * u[:, 2] + 6 * lows[:, 1] - 6 * lows[:, 2] + 0.3 * u[:, 3]
    precision = np.linalg.inv(np.cov(np.hstack([u, lows]).T) * 100 + 0.01 * np.eye(8))
    limits = LIMITS._replace(gate=60.0, slow_gate=60.0, jump=20.0, turn=1.0)
    observer = observer_of(model, precision=tuple(map(tuple, (precision + precision.T) / 2)), sensors=(limits,) * 4)
    fed(observer, 900, lambda k, u: [x + 8 * (k >= 700 and i == 1) for i, x in enumerate(u)])
    assert set(observer.validation.refused) <= {1}


def test_a_start_within_what_training_had_in_equilibrium_refuses_nothing(model: Model) -> None:
    def cooling(k, u):
        return [u[0] + 9 * np.exp(-k / 100), *u[1:]]

    observer = observer_of(model)
    fed(observer, 1, cooling)
    assert [str(each) for each in observer.validation.refused.values()] == ["reads 34 where 25.0 is expected"]
    observer = observer_of(model, sensors=(LIMITS._replace(start=10.0),) * 4)
    fed(observer, 1, cooling)
    assert not observer.validation.refused
    # nor is it doubted for long after it
    assert {each.status for each in fed(observer, 200, cooling, start=1)[:20]} == {"degraded"}
    assert {each.status for each in fed(observer, 800, cooling, start=201)[430:]} == {"tracking"}
    fed(observer, 1, lambda k, u: [u[0] + 30, *u[1:]], start=2000)
    assert list(observer.validation.refused) == [0]


def test_a_sensor_that_is_wrong_now_and_then_is_used_in_between(observer: Observer) -> None:
    found = fed(observer, 2000, lambda k, u: [u[0] + 20 * (k % 200 == 199), *u[1:]])
    assert {each.status for each in found[-180:-1]} == {"tracking"}


def drifted(k: int, u: list[float], after: float) -> list[float]:
    """A step of the first by 5 K, and the others follow to within ``after``."""
    rise = (5 - after) * (1 - np.exp(-(k - 200) / 100))
    return [u[0] + 5] + [round(value + rise, 1) for value in u[1:]]


@pytest.mark.parametrize(
    ("change", "until"),
    [
        pytest.param(lambda k, u: drifted(k, u, 0.2), 1000, id="a jump that the others follow"),
        pytest.param(lambda k, u: [25.5 if k < 800 else round(u[0] + 0.2, 1), *u[1:]], 1200, id="stuck, and then not"),
    ],
)
def test_a_refused_reading_that_stays_within_its_gate_is_used_again(observer: Observer, change, until: int) -> None:
    fed(observer, 200)
    refused = []
    for k in range(200, 2400):
        [found] = fed(observer, 1, change, start=k)
        refused.append(0 in observer.validation.refused)
    assert any(refused)
    assert not any(refused[until + 300 :])
    assert found.used[0] == change(2399, readings_at(2399))[0]


@pytest.mark.parametrize(
    "change",
    [
        pytest.param(lambda k, u: [u[0] + 3, *u[1:]], id="3 K too much"),
        pytest.param(lambda k, u: drifted(k, u, 0.9), id="beyond its gate"),
        pytest.param(lambda k, u: [25.5, *u[1:]], id="stuck"),
        pytest.param(
            lambda k, u: (
                [25.0] + [round(each - k / 400 + 2 * np.sin(min(k - 200, 900) / 900 * np.pi), 1) for each in u[1:]]
            ),
            id="stuck, where the others come back to it",
        ),
    ],
)
def test_a_lie_that_stays_is_never_used_again(observer: Observer, change) -> None:
    fed(observer, 200)
    fed(observer, 800, change, start=200)
    for k in range(1000, 2600):
        fed(observer, 1, change, start=k)
        assert list(observer.validation.refused) == [0]


@pytest.mark.parametrize("below", [0.0, 26.0])
def test_heat_that_training_lacks_is_doubted_and_used(observer: Observer, below: float) -> None:
    """No faster than it can: the reading may be right, also on its way through 0.0 degC, a driver's for none."""

    def change(k, u):
        return [round(x - below + max(0, k - 200) / 50 * (not i), 1) for i, x in enumerate(u)]

    heated = fed(observer, 500, change)
    assert heated[-1].status == "degraded"
    assert heated[-1].used[0] == pytest.approx(readings_at(499)[0] - below + 0.02 * 299, abs=0.06)
    assert heated[-1].high_degC - heated[-1].low_degC > 2 * 0.25 * 6.0


@pytest.mark.parametrize("away", [(0,), (0, 1, 2, 3)])
def test_what_moved_while_it_was_not_read_has_not_jumped(observer: Observer, away: tuple[int, ...]) -> None:
    fed(observer, 200)
    fed(observer, 40, lambda k, u: [None if i in away else x for i, x in enumerate(u)], start=200)
    fed(observer, 1, lambda k, u: [u[0] + 1.5, *(x + 0.3 for x in u[1:])], start=240)
    assert not observer.validation.refused


def test_a_silence_of_all_sensors_coasts_and_then_faults_and_what_follows_is_a_start(observer: Observer) -> None:
    fed(observer, 700)
    silent = [each.status for each in fed(observer, 120, lambda k, u: [None] * 4, start=700)]
    assert (silent[30], silent[-1]) == ("coasting", "faulted")
    assert {each.status for each in fed(observer, 20, lambda k, u: [x - 10 for x in u], start=820)} == {"tracking"}


@pytest.mark.parametrize("first", [0, 700])
@pytest.mark.parametrize("wrong", [(0, 2, 3), (0, 1, 2, 3)])
def test_what_several_report_without_a_value_is_no_reading(observer: Observer, first: int, wrong) -> None:
    fed(observer, first)
    found = fed(observer, 60, lambda k, u: [85.0 if i in wrong else value for i, value in enumerate(u)], start=first)
    found += fed(observer, 60, start=first + 60)
    off = [each.ambient_degC - 25 - k / 400 for k, each in enumerate(found, first) if each.ambient_degC is not None]
    assert len(off) >= 60
    assert max(map(abs, off)) < 0.5


@pytest.mark.parametrize("decimals", [9, 0])
def test_where_all_stand_still_for_minutes_nothing_is_read_until_one_moves(observer: Observer, decimals: int) -> None:
    """But for whole degrees, which may stand still for hours."""
    fed(observer, 700, lambda k, u: np.round(u, decimals).tolist())
    found = fed(observer, 400, lambda k, u: np.round(readings_at(699), decimals).tolist(), start=700)
    seen = [found[k].status for k in (200, 310, -1)]
    assert seen == (["tracking", "coasting", "faulted"] if decimals else ["degraded"] * 3)
    assert fed(observer, 20 if decimals else 60, start=1100)[-1].status == "tracking"


@pytest.mark.parametrize(("missing", "moves"), [((0,), True), ((0, 1), True), ((0, 1, 2), False)])
def test_a_missing_reading_moves_with_those_that_are_there(model: Model, missing, moves) -> None:
    """Unless they are too few: then it keeps its last value, and is doubted."""
    observer = observer_of(model, precision=precision_of(np.kron([[0.0, -5.0], [-5.0, 0.0]], np.ones((4, 4)))))
    fed(observer, 200)

    def absent(k, u):
        return [None if i in missing else value + 0.8 * (k - 199) for i, value in enumerate(u)]

    last = readings_at(199)[0]
    for k in range(200, 205):
        (found,) = fed(observer, 1, absent, start=k)
        expected = readings_at(k)[0] + 0.8 * (k - 199) if moves else last
        assert found.used[0] == pytest.approx(expected, abs=0.4)
    assert found.status == ("degraded" if not moves else "tracking")


@pytest.mark.parametrize(("half_width", "status"), [(0.3, "degraded"), (1.0, "tracking")])
def test_whole_degrees_widen_the_interval(model: Model, half_width: float, status: str) -> None:
    """And degrade the estimate where that is more than its usual error."""
    main = model.main._replace(interval={**model.main.interval, 90: (-half_width, half_width)})
    found = fed(observer_of(model._replace(main=main)), 300, lambda k, u: [float(round(value)) for value in u])
    assert {each.status for each in found[60:]} == {status}
    assert found[-1].high_degC - found[-1].low_degC > 2 * 1.645 * 0.39


def test_where_one_sensor_told_too_little_it_starts_again_with_the_others(model: Model) -> None:
    apart = precision_of(np.kron(np.ones((2, 2)), 400 * np.eye(4)))
    limits = LIMITS._replace(gate=90.0, slow_gate=60.0, jump=50.0)
    observer = observer_of(model, precision=apart, sensors=(limits,) * 4)
    fed(observer, 100)
    assert fed(observer, 100, lambda k, u: [u[0], None, None, None], start=100)[-1].status == "faulted"
    [back] = fed(observer, 1, lambda k, u: [x + 20 for x in u], start=200)
    assert (back.ambient_degC, observer.tracker.step) == (pytest.approx(45.5, abs=0.2), 0)


def test_the_output_stays_within_its_bounds(model: Model) -> None:
    found = fed(observer_of(model, output=(0.0, 25.2), rate_K_per_s=0.001), 600)
    assert max(each.ambient_degC for each in found) <= 25.2
    assert found[-1].status == "degraded"
    assert np.abs(np.diff([each.ambient_degC for each in found])).max() <= 0.001 + 1e-12
    assert found[-1].high_degC > 26.4, "what the bounds take off is in the interval"


def test_a_snapshot_continues_alike(model: Model, observer: Observer) -> None:
    fed(observer, 700)
    lie = fed(observer, 5, lambda k, u: [85.0, *u[1:]], start=700)[-1]
    main, background = observer.tracker.snapshot(), observer.background()
    other = observer_of(model)
    assert other.fits(main, background)
    other.tracker.restore(main)
    other.restore(main, background)
    found = [fed(each, 1, lambda k, u: [85.0, *u[1:]], start=705)[0] for each in (observer, other)]
    assert found[0].used == pytest.approx(found[1].used, abs=0.05)
    assert lie.status == found[0].status == found[1].status == "degraded"
    assert not Observer(model._replace(readings=None), other.tracker).fits(main, background)


def test_many_sensors_of_which_many_are_wrong_start_in_time(model: Model) -> None:
    many, wrong = 24, {2: 90.0, 3: 47.0, 7: -12.0, 8: 60.0, 11: 5.0, 15: 71.0, 20: -30.0, 21: 33.0}
    apart = precision_of(np.zeros((2 * many,) * 2))
    readings = model.readings._replace(mean=(25.0,) * 2 * many, precision=apart, sensors=(LIMITS,) * many)
    discrete = model.main.discrete[0]._replace(D=((1 / many,) * many,))
    main = model.main._replace(inputs=model.main.inputs * (many // 4), discrete=(discrete,))
    validation = Validation(readings, main, 1.0)
    validation.update(0.0, [wrong.get(i, 25.0) for i in range(many)])
    assert set(validation.refused) == set(wrong)


@pytest.mark.parametrize("value", [0.0, 85.0])
def test_a_lone_sensor_that_begins_with_what_is_no_reading_is_not_believed(model: Model, value: float) -> None:
    [discrete] = model.main.discrete
    main = model.main._replace(inputs=model.main.inputs[:1], discrete=(discrete._replace(D=((1.0,),)),))
    readings = model.readings._replace(lags_s=(), mean=(25.0,), precision=((0.25,),), sensors=(LIMITS,))
    observer = observer_of(model._replace(main=main, readings=readings))
    assert {observer.update(float(k), [value]).status for k in range(5)} == {"faulted"}
    assert [observer.update(float(k), [25.1]).ambient_degC for k in range(5, 20)][-1] == pytest.approx(25.1)


def test_what_is_no_temperature_may_jump_and_stay(model: Model) -> None:
    """A current of 0 A is no sensor without a value; a temperature beside it that jumps is still refused."""
    inputs = (*model.main.inputs[:3], model.main.inputs[3]._replace(name="current", unit="A"))
    unjudged = LIMITS._replace(step=1.0, jump=1e9, still_s=1e9, start=1e9)
    changed = model.readings._replace(sensors=(LIMITS,) * 3 + (unjudged,), precision=precision_of(np.eye(8) * 9))
    observer = observer_of(model._replace(main=model.main._replace(inputs=inputs), readings=changed))
    for current_A in (26.0, 0.0, 22.0, 0.0):
        fed(observer, 50, lambda k, u, now_A=current_A: [*u[:3], now_A], start=int(observer.tracker.step + 1))
        assert not observer.validation.refused
    fed(observer, 20, lambda k, u: [85.0, *u[1:3], 0.0], start=int(observer.tracker.step + 1))
    assert list(observer.validation.refused) == [0]
