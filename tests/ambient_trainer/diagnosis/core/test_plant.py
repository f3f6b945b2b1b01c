"""Modal simulation against the eighth-order integration of Kirchhoff's law."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm


def test_forced_and_decays_are_the_physics(chain) -> None:
    plant, inputs = chain.plant(), chain.inputs(220)
    start = np.array([31.0, 24.0, 18.0])
    found = plant.forced(inputs) + np.einsum("i,ink->nk", start, plant.decays(220))
    np.testing.assert_allclose(found, chain.integrated(inputs, start), atol=1e-6)


@pytest.mark.parametrize("node", [0, 1, 2])
def test_respond_is_what_heat_adds(chain, node: int) -> None:
    plant, inputs = chain.plant(), chain.inputs(160)
    heat = np.random.default_rng(node).uniform(-1, 2, 160)
    heat[70:] = 0.0
    time_s, capacity = 10.0 * np.arange(160), (10.0, 25.0, 40.0)[node]

    def into(t: float, state: np.ndarray, air: float) -> np.ndarray:
        return np.eye(3)[node] * np.interp(t, time_s, heat) / capacity

    start = np.full(3, 20.0)
    added = chain.integrated(inputs, start, into) - chain.integrated(inputs, start)
    np.testing.assert_allclose(plant.respond(node, heat), added, atol=1e-6)


def test_modal_filters_are_the_modes(chain) -> None:
    """Each row of ``modal`` solves xi' = lambda xi + drive from rest."""
    plant = chain.plant()
    drive = np.random.default_rng(2).normal(size=(3, 60))
    found = plant.modal(drive)
    time_s = 10.0 * np.arange(60)
    for m in range(3):
        xi = 0.0
        for k in range(59):
            solved = solve_ivp(
                lambda t, x, m=m: plant.rates[m] * x + np.interp(t, time_s, drive[m]),
                (time_s[k], time_s[k + 1]), [xi], method="DOP853", rtol=1e-10, atol=1e-12,
            )  # fmt: skip
            xi = solved.y[0, -1]
            assert abs(found[m, k + 1] - xi) < 1e-7


def test_modes_diagonalise_the_circuit(chain) -> None:
    plant = chain.plant(R_chip_board=3.0)
    np.testing.assert_allclose(plant.V @ plant.W, np.eye(3), atol=1e-12)
    np.testing.assert_allclose((plant.V * np.exp(plant.rates * 10)) @ plant.W, expm(10 * plant.A), atol=1e-12)


def test_a_mode_without_loss_neither_decays_nor_overflows(chain) -> None:
    """A circuit all but cut off integrates its heat: a ramp."""
    plant = chain.plant(R_board_ambient=1e14, R_shell_ambient=1e14)
    added = plant.respond(0, np.ones(500))
    total = np.array([10.0, 25.0, 40.0]) @ added
    np.testing.assert_allclose(total, 10.0 * np.arange(500), rtol=1e-3, atol=1e-6)


def test_part_holds_the_others(chain) -> None:
    """With the board a boundary, chip and shell fall apart into two one-pole circuits."""
    part = chain.plant().part(np.array([True, False, True]))
    np.testing.assert_allclose(sorted(part.rates), sorted([-1 / 80, -(1 / 12 + 1 / 15) / 40]), rtol=1e-12)
    np.testing.assert_array_equal(part.capacitance, [10.0, 40.0])


def test_names(chain) -> None:
    plant = chain.plant()
    assert plant.nodes == ("chip", "board", "shell") == plant.sensors
    np.testing.assert_array_equal(plant.reads, [0, 1, 2])
