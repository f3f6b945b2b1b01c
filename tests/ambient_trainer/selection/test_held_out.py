"""The error without a block is that of a fit which never saw it."""

import numpy as np
import pytest

from ambient_trainer.data.grid import Segment
from ambient_trainer.estimation.free_filter import FreeFilter
from ambient_trainer.estimation.search import search
from ambient_trainer.estimation.uncertainty import residuals
from ambient_trainer.estimation.validation import Spending, refitted
from ambient_trainer.selection.search import circuit_structure
from ambient_trainer.selection.topology import initial_topologies


def masked(segments, block):
    """The segments with the reference missing where the block forbids it."""
    outputs = segments[block.segment].outputs.copy()
    outputs[:, block.first : block.last] = np.nan
    return [Segment(each.period_s, each.inputs, outputs) for each in segments]


@pytest.fixture(scope="module")
def pair(small):
    rows = list(small.places("left", "right"))
    return [Segment(each.period_s, each.inputs[rows], each.outputs) for each in small.segments]


def test_squares_are_those_of_independent_fits(small, pair):
    found = refitted(FreeFilter(1, pair), small.blocks, Spending(4, 400, 60))
    assert found.solution.sum_of_squares == pytest.approx(search(FreeFilter(1, pair), 4, 0).best.sum_of_squares)
    for block, square in zip(small.blocks, found.squares):
        alone = search(FreeFilter(1, masked(pair, block)), 4, 1).best
        errors = residuals(FreeFilter(1, pair), alone)[0][0, block.start : block.stop]
        assert square == pytest.approx(np.sum(errors**2), rel=1e-4)


def test_a_budget_ends_a_search_and_keeps_its_best(small, pair):
    few = refitted(FreeFilter(2, pair), small.blocks, Spending(1, 5, 2))
    many = refitted(FreeFilter(2, pair), small.blocks, Spending(1, 100, 20))
    assert few.solution.evaluations <= 5
    assert many.solution.sum_of_squares <= few.solution.sum_of_squares


def test_a_circuit_reads_the_sensors_that_it_names(small):
    """A circuit orders its inputs by its nodes, a trace as it was logged."""
    for topology in initial_topologies(("right", "left"), 2):
        structure = circuit_structure(small.segments, small.names, (90.0, 20.0), topology)
        for row, column in enumerate(structure.circuit.inputs):
            np.testing.assert_array_equal(structure.segments[0].inputs[row], small.trace.columns[column])
