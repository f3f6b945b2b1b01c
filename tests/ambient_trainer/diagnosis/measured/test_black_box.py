"""What a black box leaves of measured sets: little more than the best circuit that an engineer found by hand."""

import itertools

import numpy as np
import pytest

from ambient_trainer.data.trace import load_trace
from ambient_trainer.evaluation.black_box import black_box_rmse_degC


@pytest.mark.parametrize(("name", "later_s", "by_hand_degC"), [("30q", 29_527, 0.18), ("li18650", 518_400, 0.24)])
def test_a_black_box_explains_what_a_circuit_does(measured, name, later_s, by_hand_degC):
    """``by_hand_degC`` is what the best circuit leaves of the first 60 %, which it was fitted to."""
    trace = load_trace(measured(name)).cut(None, later_s)
    every = slice(None, None, max(1, len(trace.time_s) // 1500))
    inputs = {each: row[every] for each, row in trace.columns.items() if each != "cell_degC"}
    samples = len(trace.time_s[every])
    edges = np.linspace(0, samples, 6).astype(int)
    blocks = [slice(start, stop) for start, stop in itertools.pairwise(edges)]
    floor = black_box_rmse_degC(trace.time_s[every], inputs, trace.columns["cell_degC"][every][None], blocks)
    assert 0.02 < floor < 1.1 * by_hand_degC
