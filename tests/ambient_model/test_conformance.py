import math

import pytest

from ambient_model import conformance
from ambient_model.conformance import conformance_of, run_recursion, worst_contradictions, worst_difference_degC
from ambient_model.model import Conformance, Discrete, Estimator, Input, Model

BANDS = {50: (-0.1, 0.1), 90: (-0.5, 0.5), 98: (-1.0, 1.0)}


def model(outputs: dict[float, tuple[float, ...]]) -> Model:
    discrete = tuple(
        Discrete(period_s, ((a,),), ((1 - a,),), ((0.25,),), ((0.5,),)) for period_s, a in ((1.0, 0.5), (2.0, 0.25))
    )
    main = Estimator((Input("usb", "degC", "usb", -20.0, 80.0),), ("case",), discrete, -1.0, ((1.0,),), BANDS)
    vector = conformance_of(main, ((20.0,), (24.0,), (24.0,)))
    return Model("m", "today", "ambient_degC", main, {}, {}, Conformance(vector.inputs, {**vector.outputs, **outputs}))


def test_a_right_file_differs_by_nothing() -> None:
    right = model({})
    assert right.conformance.outputs == {1.0: (14.0, 16.0, 16.5), 2.0: (14.0, 16.0, 16.75)}
    assert worst_difference_degC(right) == 0.0
    assert run_recursion(right.main, right.main.discrete[0], ()) == ()


@pytest.mark.parametrize("C", [0.25, 0.0], ids=["to infinity", "to no number"])
def test_a_recursion_that_overflows_agrees_with_nothing(C: float) -> None:
    right = model({})
    discrete = tuple(each._replace(B=((1e308,),), C=((C,),)) for each in right.main.discrete)
    assert worst_difference_degC(right._replace(main=right.main._replace(discrete=discrete))) == math.inf


def lagging(period_s: float, tau_s: float = 40.0) -> Discrete:
    """Two exact lags, the second of twice the time; C and D differ by period, as a first-order hold makes them."""
    a, b = math.exp(-period_s / tau_s), math.exp(-period_s / tau_s / 2)
    tilt, B = 0.01 * period_s, ((1 - a, 0.0), (0.5 * (1 - b), 0.5 * (1 - b)))
    return Discrete(period_s, ((a, 0.0), (0.0, b)), B, ((0.5 - tilt, 0.25),), ((0.25 + tilt, 0.0),))


def with_fallback(*discrete: Discrete, initial: tuple = ((1.0, 0.0), (0.5, 0.5))) -> Model:
    inputs = tuple(Input(name, "degC", name, -20.0, 80.0) for name in ("usb", "cpu", "battery"))
    stateless = tuple(Discrete(each.period_s, (), (), ((),), ((0.5, 0.25, 0.25),)) for each in discrete)
    main = Estimator(inputs, (), stateless, 0.0, (), BANDS)
    fallback = Estimator((inputs[2], inputs[0]), ("case", "core"), discrete, -1.0, initial, BANDS)
    rows = ((20.0, 70.0, 25.0), (30.0, -20.0, 24.0), (28.0, 20.0, 40.0))
    return Model("m", "today", "ambient_degC", main, {"cpu": fallback}, {}, conformance_of(main, rows))


FINE = tuple(lagging(period_s) for period_s in (1.0, 0.1, 0.25, 10.0))


@pytest.mark.parametrize(
    "discrete",
    # of periods that are no multiples, the equilibrium alone is compared
    [FINE, (lagging(1.0), lagging(2.5, tau_s=41.0)), (lagging(0.001), lagging(10.0))],
)
def test_a_right_fallback_contradicts_itself_by_rounding_only(discrete: tuple[Discrete, ...]) -> None:
    worst = worst_contradictions(with_fallback(*discrete))
    assert worst.keys() == {"cpu"}
    assert worst["cpu"] < 1e-13
    assert worst_contradictions(with_fallback(*discrete)._replace(fallbacks={})) == {}


@pytest.mark.parametrize("index", range(len(FINE)))
@pytest.mark.parametrize("name", ["A", "B"])
@pytest.mark.parametrize(("row", "column"), [(0, 0), (0, 1), (1, 0), (1, 1)])
def test_a_perturbed_coefficient_of_a_fallback_is_seen(index: int, name: str, row: int, column: int) -> None:
    matrix = [list(values) for values in getattr(FINE[index], name)]
    matrix[row][column] += 1e-7
    wrong = FINE[index]._replace(**{name: tuple(map(tuple, matrix))})
    assert worst_contradictions(with_fallback(*FINE[:index], wrong, *FINE[index + 1 :]))["cpu"] > conformance.TOLERANCE


@pytest.mark.parametrize(
    ("model", "least"),
    [
        # each period is sound by itself: the equilibrium is one, and so is the gain at rest
        (with_fallback(*FINE[:3], lagging(10.0, tau_s=41.0)), 1e-3),
        (with_fallback(*FINE, initial=((1.0, 0.0), (0.5, 0.51))), 1e-4),
        (with_fallback(*FINE[:2], FINE[2]._replace(C=((0.5, 0.251),)), FINE[3]), 1e-4),
        (with_fallback(*FINE[:2], FINE[2]._replace(D=((0.5, 0.251),)), FINE[3]), 1e-4),
        (with_fallback(*(each._replace(B=((1e308, 0.0), (0.0, 1e308))) for each in FINE)), 1e300),
    ],
    ids=["another lag", "no equilibrium", "gain at rest, C", "gain at rest, D", "overflow"],
)
def test_a_fallback_that_contradicts_itself_is_seen(model: Model, least: float) -> None:
    assert worst_contradictions(model)["cpu"] > least
