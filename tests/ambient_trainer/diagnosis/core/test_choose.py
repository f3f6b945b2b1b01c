"""Small worlds with one thing that the circuit lacks: it is named; where the circuit is right, nothing is."""

from __future__ import annotations

import numpy as np
import pytest

from ambient_trainer.diagnosis.choose import choose
from ambient_trainer.diagnosis.extended import Model
from ambient_trainer.diagnosis.joint import Teaching, fitted
from ambient_trainer.diagnosis.result import Cause
from ambient_trainer.diagnosis.teach import Taught, left_over, searched

N = 720
TIME_S = 10.0 * np.arange(N)
START = np.array([22.0, 21.5, 21.0])
CAMERA = (TIME_S % 1500 > 900) * 1.0
CAPACITY = np.array([10.0, 25.0, 40.0])


def _camera(t, x, air):
    return np.array([0, 0, 0.5 * np.interp(t, TIME_S, CAMERA)]) / CAPACITY


def _sun(t, x, air):
    return np.array([0, 0, 0.6 * (2005 <= t < 5005)]) / CAPACITY


def _case(t, x, air):
    return np.array([0, 0, -0.6 * (x[2] - air) / 15 * (t > 3005)]) / CAPACITY


def _hand(t, x, air):
    return np.array([0, 0, 0.08 * (34 - x[2]) * (2005 < t < 4505)]) / CAPACITY


def _body(t, x, air):
    flow = (x[1] - x[3]) / 6.0
    return np.array([0, -flow / 25, 0, flow / 30])


def _bridge(t, x, air):
    flow = (x[2] - x[0]) / 15.0
    return np.array([flow, 0, -flow]) / CAPACITY


def _curve(t, x, air):
    return np.array([0, 0, -(x[2] - air) / 15 * (0.08 * abs(x[2] - air) - 0.4)]) / CAPACITY


def _record(chain, seed: int, heat=None, error=None, hidden: int = 0):
    inputs = chain.inputs(N, seed)
    nodes = chain.integrated(inputs, np.append(START, [START[1]] * hidden), heat)[:3]
    read = nodes + 0.03 * np.random.default_rng(seed).standard_normal((3, N))
    return chain.record(inputs, read if error is None else error(read), camera_on=CAMERA)


def _alone(chain, record) -> Taught:
    """The circuit as well as it can be made to fit the record itself."""
    names = searched(chain.circuit)
    own = fitted(chain.model(), Teaching((record,), chain.noise(), names), 8).model
    return Taught(own, left_over(own, [record]), (), names)


def _known_good(chain) -> Taught:
    normal = (_record(chain, 11),)
    return Taught(Model(chain.plant()), left_over(chain.model(), normal), normal, ())


def _first(taught: Taught, record):
    chosen = choose(taught, [record])
    taken = chosen.choices[0].taken
    return chosen, None if taken is None else taken.effect.candidate.cause


def test_a_circuit_that_is_right_lacks_nothing(chain) -> None:
    record = _record(chain, 1)
    chosen, cause = _first(_alone(chain, record), record)
    assert cause is None
    assert len(chosen.choices) == 1
    assert chosen.choices[0].rivals == ()
    assert not chosen.final.model.effects


def test_a_device_that_is_as_it_was_has_not_changed(chain) -> None:
    assert _first(_known_good(chain), _record(chain, 1))[1] is None


def _biased(read):
    return read + np.array([0, 0, 1.0])[:, None] * ((TIME_S > 2005) & (TIME_S < 5005))


def _id(each: object) -> str:
    return str(each) if isinstance(each, Cause) else getattr(each, "__name__", "")


WITHOUT_A_BASELINE = [
    (_camera, None, 0, Cause("heat_source", "shell", "camera_on"), 0.5),
    (_sun, None, 0, Cause("heat_source", "shell"), None),
    (_case, None, 0, Cause("ambient_coupling", "shell"), None),
    (_hand, None, 0, Cause("contact", "shell"), 34.0),
    (_body, None, 1, Cause("thermal_mass", "board"), 30.0),
    (None, _biased, 0, Cause("sensor_bias", "shell"), 1.0),
]  # fmt: skip


@pytest.mark.parametrize(("heat", "error", "hidden", "wanted", "value"), WITHOUT_A_BASELINE, ids=_id)
def test_what_the_circuit_lacks(chain, heat, error, hidden, wanted, value) -> None:
    record = _record(chain, 1, heat, error, hidden)
    chosen, cause = _first(_alone(chain, record), record)
    assert cause == wanted
    trial = chosen.choices[0].taken
    assert trial.gain.p_value < 1e-6
    assert trial.gain.ci95_degC[0] > 0
    if value is not None:
        magnitude = chosen.final.model.effects[0].magnitude(chosen.final.longest)
        assert magnitude.value == pytest.approx(value, rel=0.15)


def _scaled(read):
    return read + 0.08 * (read - 25) * np.array([0, 1.0, 0])[:, None]


def _drifting(read):
    return read + 0.8 * np.array([0, 1.0, 0])[:, None] * np.maximum(0, TIME_S - 2000) / 3600


CHANGES = [
    (_camera, None, 0, Cause("heat_source", "shell", "camera_on"), 0.5),
    (_sun, None, 0, Cause("heat_source", "shell"), 0.6),
    (_case, None, 0, Cause("ambient_coupling", "shell"), -0.375),
    (_hand, None, 0, Cause("contact", "shell"), 34.0),
    (_body, None, 1, Cause("thermal_mass", "board"), 30.0),
    (_bridge, None, 0, Cause("path", "chip-shell"), 1 / 15),
    (None, _biased, 0, Cause("sensor_bias", "shell"), 1.0),
    (None, _scaled, 0, Cause("sensor_gain", "board"), 0.08),
    (None, _drifting, 0, Cause("sensor_drift", "board"), 0.8),
]  # fmt: skip


@pytest.mark.parametrize(("heat", "error", "hidden", "wanted", "value"), CHANGES, ids=_id)
def test_what_has_changed(chain, heat, error, hidden, wanted, value) -> None:
    chosen, cause = _first(_known_good(chain), _record(chain, 1, heat, error, hidden))
    assert cause == wanted
    if value is not None:
        magnitude = chosen.final.model.effects[0].magnitude(chosen.final.longest)
        assert magnitude.value == pytest.approx(value, rel=0.1)
    effect = chosen.final.model.effects[0]
    if heat in (_sun, _hand):
        assert effect.onset_s == pytest.approx(2005.0, abs=40.0)


def test_a_bent_loss_is_the_best_of_all_that_was_tried(chain) -> None:
    chosen, _ = _first(_known_good(chain), _record(chain, 1, _curve))
    best = chosen.choices[0].trials[0]
    assert best.effect.candidate.cause == Cause("convection_law", "shell")
    np.testing.assert_allclose(best.effect.values, [0.08, -0.4], rtol=0.02)


def test_progress_is_told(chain) -> None:
    told = []
    choose(_known_good(chain), [_record(chain, 1)], lambda stage, done, total: told.append((stage, done, total)))
    assert {stage for stage, _, _ in told} == {"step 1"}
    assert all(0 <= done < total for _, done, total in told)
    assert [done for _, done, _ in told] == sorted(done for _, done, _ in told)
