"""What good records teach of a circuit, how sure of it they are, and what the diagnosed ones may still move."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ambient_trainer.data.trace import Trace
from ambient_trainer.diagnosis.fit import TrainingSet, fit_model, information
from ambient_trainer.diagnosis.model import Model
from ambient_trainer.diagnosis.prior import Prior
from ambient_trainer.diagnosis.selection import _at_trained, known_good_model
from ambient_trainer.diagnosis.training import (
    TrainedCircuit,
    residual_noise,
    searched,
    train_on_baselines,
)

N = 540
TIME_S = 10.0 * np.arange(N)
START = np.array([30.0, 26.0, 22.0])


def _inputs(chain, seed: int, heater: bool = True) -> np.ndarray:
    inputs = chain.inputs(N, seed)
    return inputs if heater else inputs * np.array([1.0, 0.0])[:, None]


def _record(chain, seed: int, heater: bool = True, heat=None, **changed: float):
    inputs = _inputs(chain, seed, heater)
    # an idle device is as warm as its board: only heat tells them apart
    start = START if heater else np.full(3, 20.0)
    nodes = chain.integrated(inputs, start, heat, **changed)
    return chain.record(inputs, nodes + 0.03 * np.random.default_rng(seed).standard_normal(nodes.shape))


def _trace(record) -> Trace:
    read = dict(zip(("chip_degC", "board_degC", "shell_degC"), record.sensors))
    return Trace("run.csv", record.time_s, {"ambient_degC": record.inputs[0], "heater_W": record.inputs[1], **read})


def _known_good(chain, normal, **begun: float) -> TrainedCircuit:
    """What these records teach, from a circuit that begins elsewhere."""
    names = searched(chain.circuit)
    by_design = Prior.by_design(chain.model(), names)
    model = fit_model(chain.model(**begun), TrainingSet(normal, chain.noise(0.03), names, by_design), 15).model
    noise = residual_noise(model, normal)
    told = information(model, TrainingSet(normal, noise, names, by_design))
    return TrainedCircuit(model, noise, normal, names, Prior.trained(model, names, told))


@pytest.fixture(scope="module")
def idle(chain) -> TrainedCircuit:
    """TrainedCircuit by a device that never did anything: its chip was as warm as its board, whatever joins them."""
    return _known_good(chain, (_record(chain, 3, heater=False),), R_chip_board=20.0)


@pytest.fixture(scope="module")
def busy(chain) -> TrainedCircuit:
    return _known_good(chain, (_record(chain, 3), _record(chain, 4)), R_chip_board=11.0)


def _sure(trained: TrainedCircuit, name: str) -> float:
    """The standard error of a parameter's logarithm, as it was trained."""
    place = trained.searched.index(name)
    return float(np.sqrt(np.linalg.pinv(trained.prior.information)[place, place]))


def test_what_was_never_heated_was_hardly_taught(idle, busy) -> None:
    assert _sure(busy, "R_chip_board") < 0.01
    assert _sure(idle, "R_chip_board") > 10 * _sure(busy, "R_chip_board")


def test_what_the_good_records_hardly_told_the_diagnosed_one_tells(chain, idle) -> None:
    """It was never heated before; now it is, and nothing has changed."""
    trained = idle.model.plant.values["R_chip_board"]
    assert abs(np.log(trained / 8.0)) > 0.1
    record = _record(chain, 5)
    found = fit_model(idle.model, idle.training([record], idle.noise), 12)
    assert found.model.plant.values["R_chip_board"] == pytest.approx(8.0, rel=0.03)
    assert idle.prior.square(found.model) <= idle.prior.limit * 1.5
    assert np.sqrt(np.nanmean(found.longest.residual_degC**2)) < 0.04


def test_what_they_told_for_sure_does_not_move_to_explain_a_change(chain, busy) -> None:
    """The device is in a case now: without what was trained, its resistance would be taken to have been so always."""
    record = _record(chain, 5, R_shell_ambient=25.0)
    held = fit_model(busy.model, busy.training([record], busy.noise), 12).model
    loose = fit_model(busy.model, TrainingSet((record,), busy.noise, busy.searched), 12).model
    assert loose.plant.values["R_shell_ambient"] == pytest.approx(25.0, rel=0.03)
    assert busy.prior.square(held) <= busy.prior.limit * 1.5
    away = abs(np.log(held.plant.values["R_shell_ambient"] / busy.model.plant.values["R_shell_ambient"]))
    assert away < 5.0 * _sure(busy, "R_shell_ambient")
    assert held.plant.values["R_shell_ambient"] == pytest.approx(15.0, rel=0.05)


def test_a_device_that_is_as_it_was_stays_as_it_was_taught(chain, busy) -> None:
    found = fit_model(busy.model, busy.training([_record(chain, 6)], busy.noise), 12).model
    for name in busy.searched:
        assert found.plant.values[name] == pytest.approx(
            busy.model.plant.values[name], abs=0.0, rel=5 * _sure(busy, name)
        )


def test_the_next_effect_is_looked_for_from_where_the_circuit_was_taught(chain, busy) -> None:
    """What a circuit has moved since may be what the next effect is to explain; the effects that were found stay."""
    record = _record(chain, 5, R_shell_ambient=18.0)
    training = busy.training([record], busy.noise)
    heat = chain.effect(record, "heat_source at board", (0.3,), 1005.0, 2005.0)
    model = replace(busy.model, effects=(*busy.model.effects, heat))
    current = fit_model(model, training, 8)
    assert current.model.plant.values != busy.model.plant.values
    there = _at_trained(current, busy, training)
    assert there.model.plant.values == busy.model.plant.values
    (effect,) = there.model.effects
    np.testing.assert_array_equal(effect.values, current.model.effects[0].values)
    # without known-good records there is nothing to go back to
    alone = replace(busy, normal=())
    assert _at_trained(current, alone, training) is current


def test_trained_by_baselines(chain) -> None:
    """From traces: the circuit is found, and what is known of it stands beside, by the file or by the records."""
    trace = _trace(_record(chain, 7))
    asked = []

    def finds_nothing(trained: TrainedCircuit, normal) -> Model:
        asked.append(trained)
        return trained.model

    good = train_on_baselines(chain.circuit, [trace], 10.0, finds_nothing, None)
    (before,) = asked
    # what they lack is looked for as in any other records, by what the file says
    assert before.normal == ()
    assert np.isinf(before.prior.limit)
    assert len(good.normal) == 1
    assert np.isfinite(good.prior.limit)
    assert good.prior.about is good.model
    names = searched(chain.circuit)
    assert good.searched == good.prior.searched == names
    assert good.prior.information.shape == (len(names), len(names))
    for trained in (before, good):
        training = trained.training([], trained.noise)
        assert training.prior is trained.prior
        for name in names:
            assert trained.model.plant.values[name] == pytest.approx(chain.plant().values[name], rel=0.05)
        np.testing.assert_allclose(trained.noise.deviation_degC, 0.03, rtol=0.2)


def test_what_good_records_need_besides_belongs_to_the_model(chain) -> None:
    """A bridge that the circuit lacks and the device always had: held, known, and trained with all the rest."""

    def bridge(t: float, x: np.ndarray, air: float) -> np.ndarray:
        return (x[2] - x[0]) / 15.0 * np.array([1 / 10, 0.0, -1 / 40])

    trained = train_on_baselines(chain.circuit, [_trace(_record(chain, 8, heat=bridge))], 10.0, known_good_model, None)
    (effect,) = trained.model.effects
    assert effect.known
    assert str(effect.candidate.cause) == "path at chip-shell"
    assert trained.prior.information.shape == (len(trained.searched) + 1,) * 2
    # the diagnosed record may still move its coefficient, as far as they had not told it
    record = _record(chain, 9, heat=bridge)
    found = fit_model(trained.model, trained.training([record], trained.noise), 8)
    assert found.model.effects[0].values[0] == pytest.approx(1 / 15, rel=0.1)
    assert trained.prior.square(found.model) <= trained.prior.limit


def test_where_no_power_is_known_one_capacitance_stays(chain) -> None:
    """Temperatures alone tell heat over capacitance: all of it at once may be scaled without a trace."""
    assert searched(chain.circuit) == tuple(
        f"{kind}_{place}"
        for kind, places in (
            ("C", ("chip", "board", "shell")),
            ("R", ("chip_board", "board_shell", "board_ambient", "shell_ambient")),
        )
        for place in places
    )
    assert searched(replace(chain.circuit, sources=())) == searched(chain.circuit)[1:]
