"""The whole search on the synthetic device selects what is right, however it is run; the selection looks back."""

from dataclasses import replace

import numpy as np
import pytest

from ambient_model.faults import Refused
from ambient_trainer.data.grid import Segment
from ambient_trainer.estimation.free_filter import FreeFilter
from ambient_trainer.estimation.search import search
from ambient_trainer.estimation.uncertainty import residuals
from ambient_trainer.estimation.validation import refitted
from ambient_trainer.selection import search as search_module
from ambient_trainer.selection.grams import best_sets
from ambient_trainer.selection.report import as_json
from ambient_trainer.selection.resumable import ResumablePool
from ambient_trainer.selection.search import ScoredSystem, SearchResult, circuit_structure, flat_from, searched
from ambient_trainer.selection.topology import initial_topologies

from .conftest import AGAIN, LONER, PAIR, data_of, found_in, made_up


def test_the_right_pair_is_recommended_and_holds_on_another_run(found):
    assert found.sizes[0].sensors == (LONER,)
    assert found.sizes[1].sensors == PAIR
    assert found.recommended is found.sizes[1]
    assert found.sizes[1].rmse_degC < 0.3 * found.sizes[0].rmse_degC
    assert found.sizes[1].dc_gains == pytest.approx((-1.0, 2.0), abs=0.1)
    assert set(found.circuits) == {1, 2}
    assert found.circuits[2].topology.sensors == PAIR
    assert found.circuits[2].rmse_degC < 0.5 * found.circuits[1].rmse_degC
    assert found.circuits[2].tried > 10
    assert found.checks == (AGAIN.path,)
    own = found.sizes[1].checks_degC[0]
    assert own < 2 * found.sizes[1].rmse_degC
    assert found.circuits[2].checks_degC[0] < 0.5 * found.circuits[1].checks_degC[0]
    assert found.against.checks_degC[0] > 3 * own


@pytest.mark.slow
def test_two_processes_find_what_one_finds(found):
    assert as_json(found_in(made_up(), 2, [AGAIN])) == as_json(found)


def test_a_double_is_an_alternative():
    trace = made_up()
    noise = np.random.default_rng(9).normal(scale=0.02, size=len(trace.time_s))
    trace.columns["copy_degC"] = np.round(trace.columns["right_degC"] + noise, 2)
    pair = found_in(trace, 1, with_circuits=False).sizes[1]
    assert set(pair.sensors) in ({"left", "right"}, {"left", "copy"})
    own = next(each for each in pair.sensors if each != "left")
    other = "copy" if own == "right" else "right"
    assert (own, other) in {(each.out, each.into) for each in pair.alternatives}


def test_several_traces_are_searched_together():
    data = data_of(made_up(0), made_up(1, path="other.csv"))
    assert {each.segment for each in data.blocks} == {0, 1}
    with ResumablePool(1) as pool:
        result = searched(data, pool, with_circuits=False)
    assert result.sizes[1].sensors == PAIR
    assert tuple(each.path for each in result.data.traces) == ("made-up.csv", "other.csv")


def test_a_trace_to_check_on_is_looked_at_before_the_work():
    data = data_of(made_up())
    lacking, blind = made_up(3, path="lacking.csv"), made_up(3, path="blind.csv")
    del lacking.columns["chip_degC"], lacking.columns["right_degC"]
    blind.columns["ambient_degC"][:] = np.nan
    with ResumablePool(1) as pool:
        for check, place in ((lacking, r"lacking\.csv.*chip_degC, right_degC"), (blind, r"blind\.csv.*ambient_degC")):
            with pytest.raises(Refused, match=place):
                searched(data, pool, checks=[check])
        assert not pool.known


def test_a_swap_reaches_what_no_growth_of_a_beam_does():
    """Twenty sensors are better alone than either of the pair; one of the two shows once another is there."""

    def score(sets):
        found = []
        for each in sets:
            alone = 1.0 + 0.001 * min(each) if min(each) < 20 else 5.0
            found.append({0: alone, 1: 0.9 if len(each) == 2 else 5.0, 2: 0.1}[len({20, 21} & set(each))])
        return found

    assert best_sets(range(22), 2, score) == [(0,), (20, 21)]


def test_the_search_goes_back_to_a_smaller_set():
    """(2, 3) is only seen when (1, 2, 3) loses a member: from every single one, both its members look bad."""
    scores = {(1,): 0.9, (2,): 1.0, (3,): 1.0, (1, 2): 0.8, (1, 3): 0.8, (2, 3): 0.1, (1, 2, 3): 0.3}
    asked = []

    def score(sets):
        asked.extend(sets)
        return [scores.get(each, 5.0 + len(each)) for each in sets]

    assert best_sets(range(8), 3, score) == [(1,), (2, 3), (1, 2, 3)]


def test_squares_are_those_of_independent_fits(small):
    rows = list(search_module.numbered(small, ("left", "right")))
    pair = [Segment(each.period_s, each.inputs[rows], each.outputs) for each in small.segments]
    whole, squares = refitted(FreeFilter(1, pair), small.blocks, 4, 400, 60)
    assert whole.sum_of_squares == pytest.approx(search(FreeFilter(1, pair), 4, 0).best.sum_of_squares)
    for block, square in zip(small.blocks, squares):
        outputs = pair[0].outputs.copy()
        outputs[:, block.first : block.last] = np.nan  # the reference is missing where the block forbids it
        alone = search(FreeFilter(1, [replace(pair[0], outputs=outputs)]), 4, 1).best
        errors = residuals(FreeFilter(1, pair), alone)[0][0, block.start : block.stop]
        assert square == pytest.approx(np.sum(errors**2), rel=1e-4)


def test_a_circuit_reads_the_sensors_that_it_names(small):
    """A circuit orders its inputs by its nodes, a trace as it was logged."""
    for topology in initial_topologies(("right", "left"), 2):
        structure = circuit_structure(small.segments, small.names, (90.0, 20.0), topology)
        for row, column in enumerate(structure.circuit.inputs):
            np.testing.assert_array_equal(structure.segments[0].inputs[row], small.traces[0].columns[column])


def held_out(*mean_squares):
    squares = tuple(10 * each for each in mean_squares)
    return ScoredSystem(None, squares, (10.0,) * len(mean_squares), ())


def test_mean_square_and_its_standard_error():
    scored = held_out(1.0, 4.0, 4.0, 7.0)
    assert (scored.mean_square, scored.rmse_degC) == (4.0, 2.0)
    assert scored.standard_error_degC2 == pytest.approx((18 / 3) ** 0.5 / 2)
    low, high = scored.interval_degC
    assert (low**2, high**2) == pytest.approx((4 - scored.standard_error_degC2, 4 + scored.standard_error_degC2))
    assert replace(held_out(1, 9), samples=(10.0, 30.0)).mean_square == 2.5  # long blocks count more


def test_the_fewest_within_one_standard_error_and_where_it_is_flat():
    least = held_out(3.0, 4.0, 5.0)  # 4 and 0.577
    for second, place in ((4.5, 1), (4.6, 2)):
        sizes = (held_out(9.0, 9.0, 9.0), held_out(second, second, second), least)
        assert SearchResult(None, (), 0, sizes, None, {}, (), ()).recommended is sizes[place]
    assert flat_from([3.0, 1.0, 0.99, 0.985], 0.02) == 1
    assert flat_from([3.0, 1.0, 0.99, 0.975], 0.02) == 2
