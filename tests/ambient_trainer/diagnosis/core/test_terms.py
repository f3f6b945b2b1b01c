"""What a term adds, from any onset, against the same heat integrated."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from ambient_trainer.diagnosis.causes import all_candidates
from ambient_trainer.diagnosis.closed_loop import closed_loop
from ambient_trainer.diagnosis.model import Effect, heat_parts, view
from ambient_trainer.diagnosis.setting import setting_of
from ambient_trainer.diagnosis.terms import DriftTerm, HeatTerm, SensorTerm, beginning, ending, into, responses
from ambient_trainer.lti.lag import lagged

N = 160
TIME_S = 10.0 * np.arange(N)
CAPACITY = (10.0, 25.0, 40.0)


@pytest.fixture(scope="module")
def seen(chain):
    inputs = chain.inputs(N)
    return view(chain.model(), chain.record(inputs, chain.integrated(inputs, np.array([30.0, 26.0, 22.0]))))


def _added(chain, heat_W: np.ndarray, node: int) -> np.ndarray:
    """What heat (N,) adds, straight between samples."""
    inputs = np.stack([np.zeros(N), np.zeros(N)])
    return chain.integrated(
        inputs, np.zeros(3), lambda t, state, air: np.eye(3)[node] * np.interp(t, TIME_S, heat_W) / CAPACITY[node]
    )


@pytest.mark.parametrize("onset", [0, 1, 57, N - 1])
def test_heat_from_an_onset_on(chain, seen, onset: int) -> None:
    """What the same heat does that is zero before it and grows to its first sample from the one before."""
    weight = 1.0 + np.sin(TIME_S / 200)
    term = HeatTerm(weight, into(2, 3, lambda nodes, air: air - nodes[2]))
    (found,) = responses(seen, term, [onset])
    heat = weight * (seen.ambient_degC - seen.nodes_degC[2]) * (np.arange(N) >= onset)
    np.testing.assert_allclose(found, _added(chain, heat, 2), atol=1e-6)


def test_an_onset_at_the_end_adds_nothing(seen) -> None:
    term = HeatTerm(seen.ones, into(0, 3, lambda nodes, air: np.ones_like(air)))
    assert not responses(seen, term, [N]).any()


def test_a_window_is_one_onset_less_another(chain, seen) -> None:
    """Heat that is on from 505 s to 905 s, each edge in the middle between two samples."""
    term = HeatTerm(seen.ones, into(1, 3, lambda nodes, air: 0.7 * np.ones_like(air)))
    on, off = beginning(seen, term, [505.0, 905.0])
    inputs = np.zeros((2, N))
    capacity = np.array([0.0, 1 / 25.0, 0.0])
    wanted = chain.integrated(inputs, np.zeros(3), lambda t, state, air: capacity * 0.7 * (505.0 <= t < 905.0))
    np.testing.assert_allclose(on - off, wanted, atol=0.02)
    assert wanted.max() > 3.0


@pytest.mark.parametrize("onset_s", [None, 500.0, 502.5, 505.0, 1234.0])
@pytest.mark.parametrize("cause", ["heat_source at shell", "sensor_bias at board"])
def test_the_regressions_window_is_the_simulations(chain, seen, cause: str, onset_s: float | None) -> None:
    """What a coefficient of one adds by the regression is what the simulation then shows."""
    found = next(each for each in all_candidates(setting_of(chain.model(), [seen])) if str(each.cause) == cause)
    effect = Effect(found, onset_s, 1400.0, np.ones(1), np.eye(2))
    (term,) = found.terms(seen)
    wanted = beginning(seen, term, [onset_s])[0] - ending(seen, term, [1400.0])[0]
    if isinstance(term, HeatTerm):
        plant, nodes = chain.plant(), seen.nodes_degC
        parts = heat_parts(chain.model().with_effect(effect), plant, seen.record)
        added, _ = closed_loop(plant, parts, nodes, seen.ambient_degC, nodes, np.empty((0, 3, N)))
    else:
        added = np.zeros((3, N))
        added[1] = effect.window(seen.record)
    np.testing.assert_allclose(wanted, added, atol=1e-9)


def test_onsets_between_samples_lie_between_theirs(seen) -> None:
    term = HeatTerm(seen.ones, into(0, 3, lambda nodes, air: np.ones_like(air)))
    at = {onset: beginning(seen, term, [onset])[0] for onset in (495.0, 497.5, 500.0, 505.0)}
    np.testing.assert_allclose(at[497.5], 0.75 * at[495.0] + 0.25 * at[505.0])
    np.testing.assert_allclose(at[495.0], responses(seen, term, [50])[0])
    np.testing.assert_allclose(at[505.0], responses(seen, term, [51])[0])


def test_none_and_times_beyond_the_record(seen) -> None:
    term = HeatTerm(seen.ones, into(0, 3, lambda nodes, air: np.ones_like(air)))
    always, early, late = beginning(seen, term, [None, -1e6, 1e6])
    np.testing.assert_array_equal(always, early)
    assert not late.any()


def test_a_sensors_error(seen) -> None:
    term = SensorTerm(1, lambda reading: reading - 25.0)
    found = responses(seen, term, [0, 40])
    np.testing.assert_array_equal(found[0, 1], seen.truth_degC[1] - 25.0)
    assert not found[:, [0, 2]].any()
    assert not found[1, 1, :40].any()
    np.testing.assert_array_equal(found[1, 1, 40:], seen.truth_degC[1, 40:] - 25.0)


def test_a_drift_grows_from_its_onset(seen) -> None:
    (found,) = responses(seen, DriftTerm(2), [30])
    np.testing.assert_allclose(found[2], np.maximum(0.0, TIME_S - 300.0))
    assert not found[:2].any()


@pytest.mark.parametrize("time_constant_s", [0.5, 15.0, 400.0, 1e6])
def test_lag_is_exact_where_the_signal_runs_straight(time_constant_s: float) -> None:
    values = np.random.default_rng(3).normal(25, 2, 40)
    found = lagged(values, time_constant_s, 10.0)
    state = values[0]
    for k in range(39):
        solved = solve_ivp(
            lambda t, x, k=k: (values[k] + (values[k + 1] - values[k]) * t / 10.0 - x) / time_constant_s,
            (0.0, 10.0), [state], method="Radau" if time_constant_s < 1 else "DOP853", rtol=1e-9, atol=1e-9,
        )  # fmt: skip
        state = solved.y[0, -1]
        assert found[k + 1] == pytest.approx(state, abs=1e-5)
    assert found[0] == pytest.approx(values[0])


def test_a_memory_is_what_flows_into_a_hidden_body(chain, seen) -> None:
    """(T - body) / R, the body following with R C, integrated beside the measured shell."""
    term = HeatTerm(seen.ones, into(2, 3, lambda nodes, air: -nodes[2]), lag_s=300.0)
    shell = seen.nodes_degC[2]
    solved = solve_ivp(
        lambda t, body: (np.interp(t, TIME_S, shell) - body) / 300.0,
        (0.0, TIME_S[-1]), [shell[0]], t_eval=TIME_S, max_step=5.0, rtol=1e-9,
    )  # fmt: skip
    found = term.heat_W(seen.nodes_degC, seen.ambient_degC, 10.0)
    np.testing.assert_allclose(found[2], -(shell - solved.y[0]), atol=1e-4)
    assert not found[:2].any()
