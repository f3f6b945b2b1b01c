"""The search finds what made the data, from several starts; it can be stopped, and repeats itself."""

from dataclasses import replace

import numpy as np
import pytest

from ambient_trainer.circuits.addition import started, with_source
from ambient_trainer.data.grid import Segment
from ambient_trainer.estimation.circuit_structure import CircuitStructure
from ambient_trainer.estimation.search import Budget, search

from ..conftest import in_air, response_of, rise_inputs, truth_of


@pytest.fixture
def rise_data(rise):
    """5000 s of the ambient that a rise circuit makes of wandering sensors, seen with 0.1 degC of white noise."""
    random = np.random.default_rng(4)
    u = rise_inputs(random, 5000, 150)
    y = response_of(rise, u)
    return truth_of(rise), Segment(1.0, u, y + random.normal(size=y.shape) * 0.1)


def _off(circuit, random, factor=3.0):
    """The circuit with every free resistance and capacitance up to ``factor`` off."""
    span = np.log(factor)
    moved = [
        replace(each, initial=float(each.initial * np.exp(random.uniform(-span, span))))
        if each.free and each.unit in ("J/K", "K/W")
        else each
        for each in circuit.parameters
    ]
    return replace(circuit, parameters=tuple(moved))


@pytest.mark.parametrize(("start", "evaluation"), [(0, 5), (1, 2)])
def test_a_cancelled_search_returns_the_best_so_far(rise, rise_data, start, evaluation):
    structure = CircuitStructure(_off(rise, np.random.default_rng(0)), [rise_data[1]])
    seen, budget = [], Budget()

    def watched(*progress):
        seen.append(progress[2])
        if progress[:2] == (start, evaluation):
            budget.cancel()

    found = search(structure, 4, 0, watched, budget)
    assert found.stopped
    assert found.best.sum_of_squares == min(seen)
    assert len(found.starts) == start + 1
    assert np.isfinite(found.best.theta).all()


def test_the_same_seed_gives_the_same_result(rise, rise_data):
    _, segment = rise_data
    structure = CircuitStructure(_off(rise, np.random.default_rng(0)), [segment])
    results = [search(structure, 3, seed) for seed in (5, 5, 6)]
    for first, second in zip(results[0].starts, results[1].starts):
        np.testing.assert_array_equal(first.theta, second.theta)
        np.testing.assert_array_equal(first.beta, second.beta)
    assert results[0].starts[1].evaluations != results[2].starts[1].evaluations or not np.array_equal(
        results[0].starts[1].theta, results[2].starts[1].theta
    )
    # searches that several make are those of one
    apart = [end.theta.tolist() for first in (0, 1) for end in search(structure, 1 + first, 5, first=first).starts]
    assert apart == [end.theta.tolist() for end in results[0].starts]


def test_a_power_is_found_however_far_it_starts():
    oven = with_source(in_air("oven", 20_000, 0.05), "oven", "heater_frac", 1500.0, "1")
    u = np.vstack([np.full(5000, 20.0), np.repeat([0.0, 1.0, 0.3, 1.0, 0.0], 1000)])
    y = response_of(oven, u) + np.random.default_rng(0).normal(0.0, 0.1, (1, 5000))
    off = started(oven, {"k_oven_heater_frac": 10.0}, ["C_oven"])
    structure = CircuitStructure(off, [Segment(1.0, u, y)])
    best = search(structure, 1, 0).best
    assert structure.values(best.theta, best.beta) == pytest.approx(truth_of(oven), rel=1e-2)
