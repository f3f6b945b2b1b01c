import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ambient_model import tracking
from ambient_model.model import Discrete, Estimator, Input
from ambient_model.tracking import COASTING, FAULTED, TRACKING, WARMING_UP, Estimate, Tracker

BANDS = {50: (-0.25, 0.25), 90: (-0.5, 0.75), 98: (-1.0, 1.25)}


def random_estimator(period_s: float = 1.0, states: int = 3, inputs: int = 3) -> Estimator:
    """Some coupled circuit with a time constant of about 20 periods."""
    random = np.random.default_rng(7)
    A = random.normal(size=(states, states))
    A *= 0.95 / max(abs(np.linalg.eigvals(A)))
    shapes = {"B": (states, inputs), "C": (1, states), "D": (1, inputs)}
    matrices = {name: tuple(map(tuple, random.normal(size=shape).tolist())) for name, shape in shapes.items()}
    return Estimator(
        inputs=tuple(Input(f"s{k}", "degC", f"zone{k}", -50.0, 100.0) for k in range(inputs)),
        states=tuple(f"x{k}" for k in range(states)),
        discrete=(Discrete(period_s, tuple(map(tuple, A.tolist())), **matrices),),
        offset=0.7,
        initial=tuple(map(tuple, random.normal(size=(states, inputs)).tolist())),
        interval=BANDS,
    )


def tracker_of(estimator: Estimator) -> Tracker:
    return Tracker(estimator, estimator.discrete[0])


def wander(steps: int, inputs: int = 3) -> np.ndarray:
    return 25 + np.cumsum(np.random.default_rng(1).normal(scale=0.3, size=(steps, inputs)), axis=0)


def fed(tracker: Tracker, path: np.ndarray, start_s: float = 0.0, each_s: float = 1.0) -> list[Estimate]:
    return [tracker.update(start_s + k * each_s, u) for k, u in enumerate(path.tolist())]


def numpy_outputs(estimator: Estimator, path: np.ndarray) -> np.ndarray:
    """The outputs (k,) over ``path`` (k, m), one row a period, from the equilibrium with its first row."""
    A, B, C, D = (np.array(each) for each in estimator.discrete[0][1:])
    x = np.array(estimator.initial) @ path[0]
    outputs = []
    for u in path:
        outputs.append((C @ x + D @ u)[0] + estimator.offset)
        x = A @ x + B @ u
    return np.array(outputs)


ESTIMATOR = random_estimator()


@given(st.data(), st.sampled_from([0.0, -7.3, 1.7e9]))
@settings(max_examples=150)
def test_after_any_holes_the_state_is_that_of_the_lines_through_what_was_read(data: st.DataObject, start_s) -> None:
    """Samples at any whole periods with any readings missing, a whole one at least every 30 periods."""
    times, rows, whole = [0], [[20.0, 25.0, 30.0]], 0
    for _ in range(data.draw(st.integers(1, 25))):
        step = times[-1] + data.draw(st.integers(1, 4) | st.sampled_from([17, whole + 30 - times[-1]]))
        row = data.draw(st.lists(st.none() | st.floats(-50, 100), min_size=3, max_size=3))
        if step - whole > 25:
            step, row = min(step, whole + 30), [21.0, 26.0, 31.0]
        whole = whole if None in row else step
        times.append(step)
        rows.append(row)
    tracker = tracker_of(ESTIMATOR)
    given = [tracker.update(start_s + float(step), row) for step, row in zip(times, rows)]
    last = max(k for k, row in enumerate(rows) if None not in row)
    path = np.empty((times[last] + 1, 3))
    for column in range(3):
        known = [(step, row[column]) for step, row in zip(times[: last + 1], rows) if row[column] is not None]
        path[:, column] = np.interp(np.arange(times[last] + 1), *zip(*known))
    wanted = numpy_outputs(ESTIMATOR, path)
    for step, row, estimate in zip(times, rows, given):
        if None in row:
            assert estimate.status == COASTING
        else:
            assert estimate.status in (WARMING_UP, TRACKING)
            assert estimate.ambient_degC == pytest.approx(wanted[step], rel=1e-10, abs=1e-10)


@pytest.mark.parametrize(
    ("period_s", "limit_steps"), [(0.01, 3000), (0.1, 300), (1.0, 30), (2.5, 12), (3.0, 10), (10.0, 10), (60.0, 10)]
)
def test_beyond_the_limit_nothing_is_trusted_until_it_starts_again(period_s: float, limit_steps: int) -> None:
    assert tracking.bridge_limit_s(period_s) == pytest.approx(limit_steps * period_s)
    tracker = tracker_of(random_estimator(period_s))
    tracker.update(0.0, (20.0, 21.0, 22.0))
    missing = (20.0, None, 22.0)
    given = [tracker.update(k * period_s, missing) for k in range(1, limit_steps + 4)]
    assert [each.status for each in given] == [COASTING] * limit_steps + [FAULTED] * 3
    assert given[limit_steps:] == [Estimate(None, None, None, FAULTED, missing)] * 3
    path = wander(5)
    again = fed(tracker, path, (limit_steps + 9) * period_s, period_s)
    assert [each.status for each in again] == [WARMING_UP] * 5
    wanted = numpy_outputs(tracker.estimator, path)
    np.testing.assert_allclose([each.ambient_degC for each in again], wanted, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("value", [-50.0001, 100.0001, 1e308, -1e308, math.nan, math.inf, -math.inf])
def test_a_reading_out_of_range_is_missing(value: float) -> None:
    trackers = [tracker_of(ESTIMATOR), tracker_of(ESTIMATOR)]
    for k, u in enumerate(wander(50).tolist()):
        for tracker, stand_in in zip(trackers, (value, None)):
            estimate = tracker.update(float(k), [u[0], stand_in if 10 <= k < 20 else u[1], u[2]])
            assert (estimate.status == COASTING) == (10 <= k < 20)
        assert trackers[0].update(k + 0.1, u) == trackers[1].update(k + 0.1, u)


@pytest.mark.parametrize("period_s", [0.1, 1.0, 10.0])
def test_jitter_never_adds_up(period_s: float) -> None:
    """20 % of a period early or late, for 5,000 samples: no step is lost or doubled."""
    estimator = random_estimator(period_s)
    regular, jittered = tracker_of(estimator), tracker_of(estimator)
    late = np.random.default_rng(3).uniform(-0.2, 0.2, size=5_000).tolist()
    for k, u in enumerate(wander(5_000).clip(-50, 100).tolist()):
        assert jittered.update((k + late[k]) * period_s, u) == regular.update(k * period_s, u)


THREE, TWO = (0.1, 1.0, 10.0), (1.0, 10.0)


@pytest.mark.parametrize(
    ("periods_s", "asked_s", "chosen_s"),
    [
        *[(THREE, 0.1, 0.1), (THREE, 1.0, 1.0), ((10.0, 1.0, 0.1), 10.0, 10.0)],
        *[(THREE, 5.0, 1.0), (THREE, 0.2, 0.1), (THREE, 30.0, 10.0), (THREE, 1.09, 1.0), (THREE, 0.91, 1.0)],
        *[(TWO, 1.2, 1.0), (TWO, 0.1, 1.0), (TWO, 2.5, 1.0), ((1.0, 2.5), 2.5, 2.5), ((1.0,), 0.37, 1.0)],
    ],
)
def test_the_period_nearest_to_the_sampling(periods_s: tuple[float, ...], asked_s: float, chosen_s: float) -> None:
    [one] = ESTIMATOR.discrete
    several = ESTIMATOR._replace(discrete=tuple(one._replace(period_s=period_s) for period_s in periods_s))
    assert tracking.nearest_discrete(several, asked_s).period_s == chosen_s


HERE, LOST, GONE = (20.0, 30.0), (20.0, None), (None, None)


def quick(A: float) -> Tracker:
    """Settled after 8 steps with A = 0.68 (0.68^8 is the first power below 5 %)."""
    discrete = Discrete(1.0, ((A,),), ((0.25, 0.25),), ((1.0,),), ((0.0, 0.0),))
    inputs = tuple(Input(name, "degC", name, -20.0, 80.0) for name in ("usb", "battery"))
    return tracker_of(Estimator(inputs, ("case",), (discrete,), 0.0, ((0.5, 0.5),), BANDS))


@pytest.mark.parametrize(
    ("samples", "statuses"),
    [
        ([(k, HERE) for k in range(11)], [WARMING_UP] * 8 + [TRACKING] * 3),
        ([(0, HERE), (25, HERE), (26, LOST), (27, HERE)], [WARMING_UP, TRACKING, COASTING, TRACKING]),
        ([(0, HERE), (3, LOST), (5, HERE), (9, HERE)], [WARMING_UP, COASTING, WARMING_UP, TRACKING]),
        ([(0, HERE), (9, GONE), (30, GONE), (31, GONE)], [WARMING_UP, COASTING, COASTING, FAULTED]),
        (
            [(0, LOST), (1, GONE), (2, HERE), (9, HERE), (10, HERE)],
            [FAULTED, FAULTED, WARMING_UP, WARMING_UP, TRACKING],
        ),
        ([(0, HERE), (20, LOST), (35, HERE)], [WARMING_UP, COASTING, WARMING_UP]),
        ([(0, HERE), (9, HERE), (8, HERE), (9, HERE)], [WARMING_UP, TRACKING, WARMING_UP, WARMING_UP]),
        ([(0, HERE), (9, HERE), (8, LOST), (9, HERE)], [WARMING_UP, TRACKING, FAULTED, WARMING_UP]),
        ([(0, HERE), (9, HERE), (12, LOST), (10, HERE)], [WARMING_UP, TRACKING, COASTING, WARMING_UP]),
        ([(0, HERE), (9, HERE), (9, LOST), (9, HERE)], [WARMING_UP, TRACKING, COASTING, TRACKING]),
        ([(0, HERE), (9, HERE), (math.nan, HERE), (18, HERE)], [WARMING_UP, TRACKING, WARMING_UP, WARMING_UP]),
    ],
)
def test_the_statuses_in_order(samples: list, statuses: list[str]) -> None:
    tracker = quick(0.68)
    assert [tracker.update(time_s, readings).status for time_s, readings in samples] == statuses


def test_what_settles_at_once_never_warms_up() -> None:
    stateless = Estimator(
        (Input("usb", "degC", "usb", -20.0, 80.0),), (), (Discrete(1.0, (), (), ((),), ((1.0,),)),), -2.0, (), BANDS
    )
    tracker = tracker_of(stateless)
    assert tracker.update(0.0, (20.0,)) == Estimate(18.0, 17.5, 18.75, TRACKING, (20.0,))
    assert tracker.update(1.0, (None,)) == Estimate(18.0, 17.5, 18.75, COASTING, (20.0,))
    assert tracker.update(2.0, (30.0,)) == Estimate(28.0, 27.5, 28.75, TRACKING, (30.0,))
