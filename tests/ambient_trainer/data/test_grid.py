"""The trainer lays a trace on the grid that the device runs on."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ambient_model.faults import Refused
from ambient_model.model import Discrete, Estimator, Input
from ambient_model.tracking import Tracker
from ambient_trainer.data.grid import sampling_period_s, segments
from ambient_trainer.data.trace import Trace
from refusals import refused


def _trace(time_s, **columns):
    names = {f"{name}_degC": np.array(values, dtype=float) for name, values in columns.items()}
    return Trace("made.csv", np.array(time_s, dtype=float), names)


NAN = float("nan")

# seconds, an input, a reference; the input and the reference on a grid of a second
ON_THE_GRID = {
    "as it stands": (range(5), [1, 2, 3, 4, 5], [9, 8, NAN, 6, 5], [1, 2, 3, 4, 5], [9, 8, NAN, 6, 5]),
    "a short gap is a straight line": ([0, 1, 4, 5], [1, 2, 8, 9], [1] * 4, [1, 2, 4, 6, 8, 9], [1, 1, NAN, NAN, 1, 1]),
    "the last on a point counts": ([0, 1, 1.2, 2, 3], [0, 1, 5, 2, 3], [0, 1, 5, NAN, 3], [0, 5, 2, 3], [0, 5, NAN, 3]),
    "none before every input is there": (range(5), [NAN, NAN, 2, 3, 4], range(5), [2, 3, 4], [2, 3, 4]),
    "half a period rounds up": (np.arange(7) / 2, range(7), range(7), [0, 2, 4, 6], [0, 2, 4, 6]),
}


@pytest.mark.parametrize("what", ON_THE_GRID)
def test_a_trace_lies_on_the_grid(what):
    time_s, a, ambient, inputs, outputs = ON_THE_GRID[what]
    [found] = segments(_trace(time_s, a=a, ambient=ambient), ["a_degC"], ["ambient_degC"], 1.0)
    np.testing.assert_array_equal(found.inputs, [inputs])
    np.testing.assert_array_equal(found.outputs, [outputs])


def test_a_gap_beyond_the_bridge_begins_anew_on_a_grid_of_its_own():
    time_s = [*range(5), *(np.arange(5) + 35.4)]
    found = segments(_trace(time_s, a=range(10), ambient=range(10)), ["a_degC"], ["ambient_degC"])
    assert [each.inputs.tolist() for each in found] == [[[0, 1, 2, 3, 4]], [[5, 6, 7, 8, 9]]]
    whole = segments(_trace([*range(5), *range(34, 39)], a=range(10), ambient=range(10)), ["a_degC"], ["ambient_degC"])
    assert [each.inputs.shape for each in whole] == [(1, 39)]


def test_a_longer_gap_may_be_bridged_as_are_ten_long_periods_and_nothing_is_compared_in_it():
    time_s = [*range(5), 20, *range(40, 45)]
    trace = _trace(time_s, a=[0, 1, 2, 3, 4, NAN, 40, 41, 42, 43, 44], ambient=range(11))
    [found] = segments(trace, ["a_degC"], ["ambient_degC"], bridged_s=60.0)
    np.testing.assert_allclose(found.inputs, [range(45)])
    assert np.flatnonzero(~np.isnan(found.outputs[0])).tolist() == [*range(5), *range(40, 45)]
    assert len(segments(trace, ["a_degC"], ["ambient_degC"], bridged_s=35.0)) == 2
    for again_s, shapes in ((120, [(1, 15)]), (130, [(1, 3), (1, 3)])):
        trace = _trace([0, 10, 20, again_s, again_s + 10, again_s + 20], a=range(6), ambient=range(6))
        assert [each.inputs.shape for each in segments(trace, ["a_degC"], ["ambient_degC"], 10.0)] == shapes


def test_what_is_too_short_is_refused():
    trace = _trace([0, 100, 200], a=range(3), ambient=range(3))
    said = str(refused(segments, trace, ["a_degC"], ["ambient_degC"], 1.0))
    assert "made.csv: columns a_degC: no 3 samples in a row" in said


@pytest.mark.parametrize(
    ("time_s", "period_s"),
    [
        ([0.0], 1.0),
        ([0, 1, 2, 3], 1.0),
        ([0, 9.993, 20.033, 30.02, 40.06], 10.01),
        ([0, 0.1, 0.2, 0.3, 60.3, 60.4], 0.1),
        ([0, 1, 2, 2.01, 3, 4, 5], 0.998),
    ],
)
def test_the_period_is_that_of_the_usual_step(time_s, period_s):
    assert sampling_period_s(np.array(time_s, dtype=float)) == pytest.approx(period_s, rel=1e-3)


def test_the_period_drifts_by_less_than_a_sample_over_a_long_trace():
    assert abs(sampling_period_s(np.arange(100_000) * 0.99996) - 0.99996) * 99_999 <= 0.25 * 1.0001


A = ((0.8, 0.1), (0.05, 0.7))
B = ((0.1, 0.0), (0.05, 0.2))
C, D = ((0.7, -0.4),), ((0.3, 0.2),)
X0 = tuple(map(tuple, np.linalg.solve(np.eye(2) - np.array(A), np.array(B)).tolist()))
INPUTS = tuple(Input(name, "degC", name, -1000.0, 1000.0) for name in "ab")


STEPS_S = st.sampled_from([0.2, 0.5, 0.9, 1.0, 1.0, 1.0, 1.1, 3.0, 12.7, 29.0, 30.4, 31.0, 45.0])


@st.composite
def irregular_traces(draw):
    """Steps from a fifth of a period to beyond the bridge, jitter, values missing one by one."""
    time_s = np.cumsum([draw(st.floats(0, 100)), *draw(st.lists(STEPS_S, min_size=8, max_size=40))])
    random = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    values = random.uniform(10, 40, size=(2, len(time_s)))
    values[random.uniform(size=values.shape) < draw(st.sampled_from([0, 0.1, 0.4]))] = np.nan
    return time_s, values


@given(irregular_traces())
@settings(max_examples=80)
def test_the_recursion_over_segments_is_what_the_device_says(drawn):
    """Output ``ambient`` carries the sample's number, which tells where on which segment it lies.

    Where several samples share the first grid point the device starts from the first of them, the trainer from the
    last; those segments are left out.
    """
    time_s, values = drawn
    trace = _trace(time_s, a=values[0], b=values[1], ambient=np.arange(len(time_s)))
    try:
        found = segments(trace, ["a_degC", "b_degC"], ["ambient_degC"], 1.0)
    except Refused:
        return
    discrete = Discrete(1.0, A, B, C, D)
    estimator = Estimator(INPUTS, ("x", "y"), (discrete,), 0.5, X0, {50: (0, 0), 90: (0, 0), 98: (0, 0)})
    tracker = Tracker(estimator, discrete)
    readings = [[None if np.isnan(each) else float(each) for each in row] for row in values.T]
    said = [tracker.update(float(time), row).ambient_degC for time, row in zip(time_s, readings)]
    for segment in found:
        first = int(segment.outputs[0, 0])
        if any(None not in readings[k] and time_s[first] - time_s[k] < 0.51 for k in range(first)):
            continue
        x = np.array(X0) @ segment.inputs[:, 0]
        for u, number in zip(segment.inputs.T, segment.outputs[0]):
            if not np.isnan(number) and None not in readings[int(number)]:
                expected = np.array(C) @ x + np.array(D) @ u + 0.5
                assert said[int(number)] == pytest.approx(expected.item(), abs=1e-9)
            x = np.array(A) @ x + np.array(B) @ u


@given(st.integers(3, 200), st.integers(1, 30))
def test_pieces_lie_end_to_end(samples, count):
    [whole] = segments(_trace(range(samples), a=range(samples), ambient=range(samples)), ["a_degC"], ["ambient_degC"])
    pieces = whole.pieces(count)
    assert 1 <= len(pieces) <= count
    np.testing.assert_array_equal(np.concatenate([each.inputs for each in pieces], axis=1), whole.inputs)
    np.testing.assert_array_equal(np.concatenate([each.outputs for each in pieces], axis=1), whole.outputs)
    assert min(each.inputs.shape[1] for each in pieces) >= min(3, samples)
    assert {each.period_s for each in pieces} == {1.0}
