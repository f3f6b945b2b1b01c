"""What each unknown does, all heat answering: differences of the integrated nonlinear system."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ambient_trainer.diagnosis.effect_parameters import EffectParameter, Kind, unknowns
from ambient_trainer.diagnosis.model import view
from ambient_trainer.diagnosis.sensitivities import columns

PERIOD_S = 10.0


def _column(world, unknown: EffectParameter) -> np.ndarray:
    seen = view(world.model, world.record)
    (found,) = columns(world.model, (), (unknown,), seen)
    return found


def _alike(found: np.ndarray, wanted: np.ndarray, share: float = 0.02) -> None:
    assert np.abs(wanted).max() > 1e-3
    np.testing.assert_allclose(found, wanted, atol=share * np.abs(wanted).max())


PARAMETERS = ["C_shell", "R_chip_board", "R_board_shell", "R_shell_ambient"]


@pytest.mark.parametrize("name", ["C_shell", "R_board_shell", "R_shell_ambient"])
@pytest.mark.parametrize("world", ["convection", "mass"], indirect=True)
def test_a_parameter(world, name: str) -> None:
    """By its logarithm; what an effect says of a resistance, too, moves with it."""
    seen = view(world.model, world.record)
    (found,) = columns(world.model, (name,), (), seen)
    value, step = world.model.plant.values[name], 1e-2
    up, down = (world.integrated(**{name: value * np.exp(s)}) for s in (step, -step))
    _alike(found, (up - down) / (2 * step))


@pytest.mark.parametrize("world", ["coupling for a while", "convection", "contact"], indirect=True)
def test_a_coefficient(world) -> None:
    for term, value in enumerate(world.case.values):
        step = 0.02 * max(abs(each) for each in world.case.values)
        ends = [
            world.integrated([*world.case.values[:term], value + sign * step, *world.case.values[term + 1 :]])
            for sign in (1, -1)
        ]
        _alike(_column(world, EffectParameter(0, Kind.COEFFICIENT, term)), (ends[0] - ends[1]) / (2 * step))


@pytest.mark.parametrize("world", ["mass", "mass that is attached"], indirect=True)
def test_a_shape(world) -> None:
    up, down = (world.integrated(case=replace(world.case, shape=300.0 * np.exp(step))) for step in (0.02, -0.02))
    _alike(_column(world, EffectParameter(0, Kind.SHAPE)), (up - down) / 0.04)


@pytest.mark.parametrize("kind", [Kind.ONSET, Kind.END])
@pytest.mark.parametrize("world", ["coupling for a while", "contact"], indirect=True)
def test_an_edge(world, kind: Kind) -> None:
    """By as much as a sample is long: the edge is no sharper than that."""
    name = "onset_s" if kind is Kind.ONSET else "end_s"
    edge = getattr(world.case, name)
    moved = world.integrated(case=replace(world.case, **{name: edge + PERIOD_S}))
    _alike(_column(world, EffectParameter(0, kind)), (moved - world.nodes_degC) / PERIOD_S, 0.06)
    up, down = (world.integrated(case=replace(world.case, **{name: edge + step})) for step in (1.0, -1.0))
    later = slice(int(edge / PERIOD_S) + 10, None)
    _alike(_column(world, EffectParameter(0, kind))[:, later], ((up - down) / 2.0)[:, later], 0.06)


@pytest.mark.parametrize("world", ["coupling for a while"], indirect=True)
def test_all_at_once_are_each_alone(world) -> None:
    seen = view(world.model, world.record)
    free = unknowns(world.model, known=False)
    assert [each.kind for each in free] == [Kind.COEFFICIENT, Kind.ONSET, Kind.END]
    together = columns(world.model, PARAMETERS, free, seen)
    alone = [columns(world.model, (name,), (), seen)[0] for name in PARAMETERS] + [
        _column(world, each) for each in free
    ]
    np.testing.assert_allclose(together, alone, atol=1e-9)
    assert columns(world.model, (), (), seen).shape == (0, 3, world.record.samples)


@pytest.mark.parametrize("world", ["coupling for a while"], indirect=True)
def test_what_a_wrong_gain_reads_of_a_parameter(world) -> None:
    """Of all that moves, the faulty sensor shows its own share, while the fault lasts; the others show it as it is."""
    model = world.model.with_effect(world.chain.effect(world.record, "sensor_gain at shell", (0.1, 0.4), 805.0, 1405.0))
    free = unknowns(model, known=False)
    seen = view(model, world.record)
    found = columns(model, PARAMETERS, free, seen)
    straight = columns(world.model, PARAMETERS, free[:3], view(world.model, world.record, seen))
    at = np.arange(world.record.samples) * PERIOD_S
    read = (
        np.where((at > 805) & (at < 1405), 1.1, 1.0) * np.array([0, 0, 1.0])[:, None] + np.array([1, 1, 0.0])[:, None]
    )
    # where the heat is found from what is read, the simulation differs by what the fit of the start makes of the fault
    np.testing.assert_allclose(found[:7], straight * read, atol=0.03 * np.abs(straight).max())
    gain, bias, onset, end = found[7:]
    on = (at > 805) & (at < 1405)
    np.testing.assert_allclose(gain[2], (seen.truth_degC[2] - 25.0) * on, atol=1e-6)
    np.testing.assert_allclose(bias[2], 1.0 * on, atol=1e-6)
    for column, edge, sign in ((onset, 805.0, -1.0), (end, 1405.0, 1.0)):
        moved = np.flatnonzero(column[2])
        np.testing.assert_array_equal(moved, [round((edge + 5.0) / PERIOD_S)])
        error = 0.1 * (seen.truth_degC[2, moved[0]] - 25.0) + 0.4
        assert column[2, moved[0]] == pytest.approx(sign * error / PERIOD_S)
    assert not found[7:, :2].any()


@pytest.mark.parametrize("world", ["coupling for a while"], indirect=True)
def test_a_sensor_that_is_stuck_shows_nothing(world) -> None:
    on = slice(81, 141)
    read = world.nodes_degC.copy()
    read[2, on] = 27.0
    record = world.chain.record(world.record.inputs, read)
    stuck = world.chain.effect(record, "sensor_stuck at shell", (27.0, 1.0), 805.0, 1405.0)
    model = world.model.with_effect(stuck)
    free = unknowns(model, known=False)
    seen = view(model, record)
    found = columns(model, PARAMETERS, free, seen)
    np.testing.assert_allclose(seen.simulated_degC[2, on], 27.0)
    assert np.abs(found[:-1, 2, on]).max() < 1e-9
    assert (np.abs(found[:4, 2, 141:]).max(axis=-1) > 0.1).all()
    # what it always reads is its own, and no edge is free: when it stood still was seen
    assert free[3:] == (EffectParameter(1, Kind.COEFFICIENT, 0),)
    np.testing.assert_allclose(found[-1, 2], [1.0 if 81 <= k < 141 else 0.0 for k in range(240)])
