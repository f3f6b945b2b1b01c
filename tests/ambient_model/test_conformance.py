import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ambient_model.conformance import TOLERANCE_DEGC, conformance_of, run_recursion, worst_difference_degC
from ambient_model.model import Conformance, Discrete, Estimator, Input, Model

BANDS = {50: (-0.1, 0.1), 90: (-0.5, 0.5), 98: (-1.0, 1.0)}


@given(st.from_type(Estimator), st.data())
def test_the_recursion_is_numpys(estimator: Estimator, data: st.DataObject) -> None:
    n, m = len(estimator.states), len(estimator.inputs)
    rows = data.draw(st.lists(st.tuples(*[st.floats(-40, 90)] * m), max_size=12))
    vector = conformance_of(estimator, tuple(rows))
    assert set(vector.outputs) == {each.period_s for each in estimator.discrete}
    for discrete in estimator.discrete:
        A, B = np.reshape(discrete.A, (n, n)), np.reshape(discrete.B, (n, m))
        C, D = np.reshape(discrete.C, n), np.reshape(discrete.D, m)
        x = np.reshape(estimator.initial, (n, m)) @ rows[0] if rows else np.zeros(n)
        wanted = []
        for u in rows:
            wanted.append(float(C @ x + D @ u + estimator.offset))
            x = A @ x + B @ u
        assert vector.outputs[discrete.period_s] == pytest.approx(wanted, rel=1e-12, abs=1e-9)


def model(outputs: dict[float, tuple[float, ...]], scale: float = 1.0) -> Model:
    discrete = tuple(
        Discrete(period_s, ((a,),), ((scale * (1 - a),),), ((0.25,),), ((0.5,),))
        for period_s, a in ((1.0, 0.5), (2.0, 0.25))
    )
    main = Estimator((Input("usb", "degC", "usb", -20.0, 80.0),), ("case",), discrete, -1.0, ((1.0,),), BANDS)
    vector = conformance_of(main, ((20.0,), (24.0,), (24.0,)))
    return Model("m", "today", "ambient_degC", main, {}, {}, Conformance(vector.inputs, {**vector.outputs, **outputs}))


def test_a_right_file_differs_by_nothing() -> None:
    right = model({})
    assert right.conformance.outputs == {1.0: (14.0, 16.0, 16.5), 2.0: (14.0, 16.0, 16.75)}
    assert worst_difference_degC(right) == 0.0


@pytest.mark.parametrize("period_s", [1.0, 2.0])
@pytest.mark.parametrize("row", [0, 1, 2])
@pytest.mark.parametrize("error", [-0.125, 2 * TOLERANCE_DEGC])
def test_a_wrong_output_is_seen_wherever_it_stands(period_s: float, row: int, error: float) -> None:
    wrong = list(model({}).conformance.outputs[period_s])
    wrong[row] += error
    assert worst_difference_degC(model({period_s: tuple(wrong)})) == pytest.approx(abs(error), rel=1e-5)


def test_a_perturbed_coefficient_is_seen() -> None:
    right = model({})
    assert worst_difference_degC(model(right.conformance.outputs, scale=1 + 1e-9)) > TOLERANCE_DEGC


@pytest.mark.parametrize("C", [0.25, 0.0], ids=["to infinity", "to no number"])
def test_a_recursion_that_overflows_agrees_with_nothing(C: float) -> None:
    right = model({})
    discrete = tuple(each._replace(B=((1e308,),), C=((C,),)) for each in right.main.discrete)
    assert worst_difference_degC(right._replace(main=right.main._replace(discrete=discrete))) == math.inf


def test_no_rows_no_outputs() -> None:
    main = model({}).main
    assert run_recursion(main, main.discrete[0], ()) == ()
