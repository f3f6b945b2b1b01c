"""Circuits with effects against the nonlinear system integrated, by whole runs over and over and step by step."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from ambient_trainer.diagnosis import extended
from ambient_trainer.diagnosis.causes import all_candidates
from ambient_trainer.diagnosis.extended import Effect, Model, view
from ambient_trainer.diagnosis.setting import setting_of

N = 240
TIME_S = 10.0 * np.arange(N)
START = np.array([32.0, 27.0, 23.0])
Heat = Callable[[float, np.ndarray, float], np.ndarray]


def _coupling(t: float, x: np.ndarray, air: float) -> np.ndarray:
    return np.array([0.0, 0.0, -0.8 * (x[2] - air) / 15 / 40])


def _contact(t: float, x: np.ndarray, air: float) -> np.ndarray:
    return np.array([0.0, 0.0, 0.2 * (36.0 - x[2]) / 40 * (605 <= t < 1605)])


def _convection(t: float, x: np.ndarray, air: float) -> np.ndarray:
    lost = [(x[k] - air) / R * (0.04 * abs(x[k] - air) - 0.3) / C for k, R, C in ((1, 30, 25), (2, 15, 40))]
    return np.array([0.0, *(-each for each in lost)])


def _path(t: float, x: np.ndarray, air: float) -> np.ndarray:
    flow = (x[2] - x[0]) / 15.0
    return np.array([flow / 10, 0.0, -flow / 40])


def _mass(t: float, x: np.ndarray, air: float) -> np.ndarray:
    flow = (x[1] - x[3]) / 5.0
    return np.array([0.0, -flow / 25, 0.0, flow / 60])


def _weak_mass(t: float, x: np.ndarray, air: float) -> np.ndarray:
    flow = (x[1] - x[3]) * 0.02
    return np.array([0.0, -flow / 25, 0.0, flow / 12])


CASES: dict[str, tuple[Heat, str, float | None, list[float], tuple[float | None, float | None], int]] = {
    "coupling": (_coupling, "ambient_coupling at shell", None, [0.8], (None, None), 0),
    "contact": (_contact, "contact at shell", None, [0.2, 0.2 * 11], (605.0, 1605.0), 0),
    "convection": (_convection, "convection_law", None, [0.04, -0.3], (None, None), 0),
    "weak path": (lambda t, x, air: _path(t, x, air) / 4, "path at chip-shell", None, [1 / 60], (None, None), 0),
    "weak mass": (_weak_mass, "thermal_mass at board", 600.0, [0.02], (None, None), 1),
    "path": (_path, "path at chip-shell", None, [1 / 15], (None, None), 0),
    "mass": (_mass, "thermal_mass at board", 300.0, [0.2], (None, None), 1),
}  # fmt: skip


def _case(chain, name: str) -> tuple[Model, np.ndarray, np.ndarray]:
    """The model with the effect, the inputs, and the true nodes."""
    heat, cause, shape, values, (onset_s, end_s), hidden = CASES[name]
    inputs = chain.inputs(N)
    start = np.append(START, [START[1]] * hidden)
    nodes = chain.integrated(inputs, start, heat)[:3]
    model = chain.model()
    setting = setting_of(model, [view(model, chain.record(inputs, nodes))])
    candidate = next(each for each in all_candidates(setting) if str(each.cause) == cause)
    if shape is not None and candidate.reshaped is not None:
        candidate = candidate.reshaped(shape)
    count = len(values)
    return model.with_effect(Effect(candidate, onset_s, end_s, np.array(values), np.eye(count))), inputs, nodes


def _plain(model: Model, inputs: np.ndarray) -> np.ndarray:
    return model.plant.forced(inputs) + np.einsum("i,ink->nk", START, model.plant.decays(N))


def _never(*given: object) -> None:
    raise AssertionError("the other way was to be taken")


# where the heat is as large as the circuit's own, whole runs do not settle
@pytest.mark.parametrize(
    ("way", "name"),
    [("iterated", each) for each in CASES if each not in ("path", "mass")] + [("step by step", each) for each in CASES],
)
def test_the_nonlinear_system(chain, monkeypatch: pytest.MonkeyPatch, name: str, way: str) -> None:
    if way == "iterated":
        monkeypatch.setattr(extended, "_step_by_step", _never)
    else:
        monkeypatch.setattr(extended, "_ROUNDS", 0)
    model, inputs, nodes = _case(chain, name)
    plain = _plain(model, inputs)
    added = extended._added(model, chain.record(inputs, nodes), plain, plain)
    effect = np.abs(nodes - plain).max()
    assert effect > 0.5
    # the edge of a window falls between two samples, where heat is not straight
    assert np.abs(plain + added - nodes).max() < (0.02 if name != "contact" else 0.04)


@pytest.mark.parametrize("name", CASES)
def test_a_view_of_the_true_model_leaves_nothing(chain, name: str) -> None:
    model, inputs, nodes = _case(chain, name)
    seen = view(model, chain.record(inputs, nodes))
    assert np.sqrt(np.mean(seen.residual_degC**2)) < 0.01
    np.testing.assert_allclose(seen.start, START, atol=0.05)
    without = view(Model(model.plant), chain.record(inputs, nodes))
    assert np.sqrt(np.mean(without.residual_degC**2)) > 0.05


def test_the_guess_does_not_matter(chain) -> None:
    model, inputs, nodes = _case(chain, "convection")
    plain, record = _plain(model, inputs), chain.record(inputs, nodes)
    one, other = (extended._added(model, record, plain, guess) for guess in (plain, nodes + 3.0))
    np.testing.assert_allclose(one, other, atol=0.01)


def test_sensor_errors_are_of_the_truth(chain) -> None:
    inputs = chain.inputs(N)
    nodes = chain.integrated(inputs, START)
    model = chain.model()
    setting = setting_of(model, [view(model, chain.record(inputs, nodes))])
    found = {str(each.cause): each for each in all_candidates(setting)}
    read = nodes.copy()
    read[1] += 0.1 * (nodes[1] - 25.0) + 0.4
    read[2] += 2.0 / 3600 * np.maximum(0.0, TIME_S - 800.0)
    for cause, onset_s, values in (
        ("sensor_gain at board", None, [0.1, 0.4]),
        ("sensor_drift at shell", 800.0, [2 / 3600]),
    ):
        effect = Effect(found[cause], onset_s, None, np.array(values), np.eye(len(values)))
        model = model.with_effect(effect)
    seen = view(model, chain.record(inputs, read))
    np.testing.assert_allclose(seen.simulated_degC[:, 20:], read[:, 20:], atol=0.03)
    np.testing.assert_allclose(seen.truth_degC[:, 20:], nodes[:, 20:], atol=0.03)
    # what a doubtful sensor reads is not taken for the node
    np.testing.assert_allclose(seen.nodes_degC[:, 20:], nodes[:, 20:], atol=0.03)
    assert model.believed() == {0}


def test_an_effect_that_was_always_there_makes_no_sensor_doubtful(chain) -> None:
    inputs = chain.inputs(N)
    model = chain.model()
    setting = setting_of(model, [view(model, chain.record(inputs, chain.integrated(inputs, START)))])
    late = next(each for each in all_candidates(setting) if str(each.cause) == "sensor_lag at board")
    assert model.with_effect(Effect(late, None, None, np.ones(1), np.eye(1), known=True)).believed() == {0, 1, 2}


@pytest.mark.parametrize(("onset_s", "first"), [(None, 1.0), (0.0, 0.5), (-5.0, 1.0), (5.0, 0.0)])
def test_a_window_is_the_share_of_each_sample(chain, onset_s: float | None, first: float) -> None:
    record = chain.record(np.zeros((2, 5)), np.zeros((3, 5)))
    window = extended.windowed(record, onset_s)
    assert window[0] == first
    np.testing.assert_array_equal(window[1:], np.ones(4))
    np.testing.assert_allclose(extended.windowed(record, 22.5), [0, 0, 0.25, 1, 1])


def test_a_runaway_is_no_simulation_and_no_crash(chain) -> None:
    """Heat that grows with the temperature without bound: told by its not being finite."""
    model, inputs, nodes = _case(chain, "coupling")
    wild = Model(model.plant, (Effect(model.effects[0].candidate, None, None, np.array([-40.0]), np.eye(1)),))
    seen = view(wild, chain.record(inputs, nodes))
    assert not np.isfinite(seen.simulated_degC).all()
