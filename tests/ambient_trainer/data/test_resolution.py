"""Steps are recognised, and imposed on what was logged finer."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ambient_model.faults import Refused
from ambient_trainer.data.resolution import resolution_of, with_resolution
from ambient_trainer.data.trace import Trace


@given(st.sampled_from([1.0, 0.5, 0.25, 0.125, 0.1, 0.0625, 0.05, 0.01]), st.integers(0, 1000))
def test_a_step_is_recognised(step, seed):
    values = step * np.round(np.random.default_rng(seed).uniform(-40, 90, 300) / step)
    values[::7] = np.nan
    assert resolution_of(values) == step


def test_what_has_no_step_has_none():
    assert resolution_of(np.random.default_rng(1).uniform(-40, 90, 300)) == 0.0


def test_a_trace_is_rounded_where_asked():
    trace = Trace("t", np.arange(3.0), {"a_degC": np.array([1.2, 1.6, np.nan]), "b_degC": np.array([1.2, 1.6, 2.4])})
    coarse = with_resolution(trace, {"a_degC": 0.5})
    assert coarse.columns["a_degC"][:2].tolist() == [1.0, 1.5]
    assert np.isnan(coarse.columns["a_degC"][2])
    assert coarse.columns["b_degC"] is trace.columns["b_degC"]


@pytest.mark.parametrize(("name", "step"), [("c_degC", 1.0), ("a_degC", 0.0), ("a_degC", float("nan"))])
def test_an_unknown_sensor_and_a_step_of_nothing_are_refused(name, step):
    with pytest.raises(Refused):
        with_resolution(Trace("t", np.arange(2.0), {"a_degC": np.zeros(2)}), {name: step})
