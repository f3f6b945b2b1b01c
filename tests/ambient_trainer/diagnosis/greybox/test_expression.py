"""Expressions against numpy, and what is no expression."""

import contextlib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ambient_model.faults import Refused
from ambient_trainer.diagnosis.greybox.expression import LATE, Expression, Samples
from refusals import refused

TIME_S = 10.0 * np.arange(50)
COLUMNS = {"current_A": np.sin(TIME_S), "charge_As": TIME_S, "ambient_degC": 20 + np.cos(TIME_S)}
SAMPLES = Samples(COLUMNS, 10.0)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("current_A^2", np.sin(TIME_S) ** 2),
        ("current_A^2 * charge_As", np.sin(TIME_S) ** 2 * TIME_S),
        ("d(charge_As)/dt", np.ones(50)),
        ("ambient_degC > 20.5", 1.0 * (COLUMNS["ambient_degC"] > 20.5)),
        ("-2 * (charge_As - 5) / 4", -(TIME_S - 5) / 2),
        ("sqrt(abs(current_A))", np.sqrt(np.abs(np.sin(TIME_S)))),
        ("lag(ambient_degC, 0)", COLUMNS["ambient_degC"]),
        ("delay(charge_As, 25)", np.maximum(TIME_S - 25, 0)),
    ],
)
def test_expressions_are_what_they_say(text, value):
    assert Expression(text).value(SAMPLES) == pytest.approx(value, abs=1e-9)


def test_columns_are_those_that_are_read_and_a_level_or_a_delay_is_a_number_of_its_own():
    assert Expression("d(current_A^2)/dt * sqrt(charge_As)").columns == ("current_A", "charge_As")
    assert [Expression(each).per("W") for each in ("wind_m_s^2", "current_A^2")] == ["W/(m/s)^2", "W/A^2"]
    late = ((f"{each}(charge_As, 25)", f"{each}(charge_As, 30)") for each in LATE)
    for text, moved in (*late, ("current_A > -0.5", "current_A > 30")):
        expression = Expression(text)
        assert expression.level == float(text.strip(")").split()[-1])
        assert expression.at_level(30.0).text == moved
        assert expression.form == expression.at_level(30.0).form
    assert Expression("current_A^2").level is None


@pytest.mark.parametrize(
    "text",
    [
        *("", "volts", "__import__('os')", "current_A.real", "[1]", "current_A if 1 else 2", "f(1)"),
        *("sqrt()", "lag(current_A)", "lag(current_A, -5)", "delay(current_A, charge_As)", "delay(current_A, 1e999)"),
    ],
)
def test_what_is_no_expression_is_refused(text):
    refused(Expression(text).value, SAMPLES)


@settings(max_examples=50, deadline=None)
@given(st.text(max_size=40))
def test_any_text_is_a_value_or_refused(text):
    with contextlib.suppress(Refused):
        assert Expression(text).value(SAMPLES).shape == (50,)
