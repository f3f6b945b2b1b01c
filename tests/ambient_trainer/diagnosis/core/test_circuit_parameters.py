"""Parameters move by the logarithm, shares by as much of themselves, and what moved can be told again."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ambient_trainer.diagnosis.circuit_parameters import bounded, changed, moved_by, moved_to, traded
from ambient_trainer.diagnosis.plant import Plant

STEPS = st.floats(-0.69, 0.69)


def test_moves_are_by_the_logarithm_and_held_back(chain) -> None:
    plant = chain.plant()
    assert changed(plant, "C_chip", 0.1) == pytest.approx(10 * np.exp(0.1))
    assert changed(plant, "C_chip", 9.0) == pytest.approx(10 * np.exp(0.7))
    assert changed(plant, "C_chip", -9.0) == pytest.approx(10 * np.exp(-0.7))
    assert bounded(chain.plant(C_chip=45.0), "C_chip", 0.5) == 50.0
    assert bounded(chain.plant(C_chip=2.5), "C_chip", -0.5) == 2.0


@pytest.mark.parametrize(("value", "step", "wanted"), [(0.6, -0.2, 0.48), (0.0, 0.5, 0.05), (-0.04, 0.5, 0.01)])
def test_a_share_moves_by_as_much_of_itself_and_through_zero(shared, value: float, step: float, wanted: float) -> None:
    assert changed(shared.plant(share=value), "share", step) == pytest.approx(wanted)
    assert bounded(shared.plant(share=0.01), "share", -0.5) == 0.0


@given(step=STEPS, name=st.sampled_from(["R_chip_board", "share"]))
def test_the_way_back(shared, step: float, name: str) -> None:
    plant = shared.plant()
    assert moved_to(plant, name, changed(plant, name, step)) == pytest.approx(step, abs=1e-12)


@given(first=STEPS, second=STEPS, name=st.sampled_from(["R_chip_board", "share"]))
def test_a_step_from_elsewhere_adds_its_scale_to_the_way(shared, first: float, second: float, name: str) -> None:
    """Two moves one after the other are one of their sum, the second in units of the first's."""
    plant = shared.plant()
    there = Plant.of(plant.circuit, {**plant.values, name: changed(plant, name, first)}, plant.period_s)
    way, scale = moved_by(plant, there, name)
    assert way == pytest.approx(first, abs=1e-12)
    beyond = Plant.of(plant.circuit, {**there.values, name: changed(there, name, second)}, plant.period_s)
    assert moved_by(plant, beyond, name)[0] == pytest.approx(way + scale * second, abs=1e-9)


@pytest.mark.parametrize(
    ("name", "step", "wanted"),
    [("C_chip", 0.1, 11.0), ("C_chip", -9.0, 3.0), ("R_chip_board", 0.2, 10.0), ("R_chip_board", -0.6, 5.0),
     ("R_chip_board", 9.0, 8 / 0.3), ("share", -0.2, 0.48)],
)  # fmt: skip
def test_a_trade_is_straight_in_conductances_and_capacitances(shared, name: str, step: float, wanted: float) -> None:
    plant = shared.plant()
    assert traded(plant, name, step) == pytest.approx(wanted)
    # short steps are alike
    assert traded(plant, name, 1e-4) == pytest.approx(changed(plant, name, 1e-4), rel=1e-7)
    assert bounded(shared.plant(C_chip=45.0), "C_chip", 0.5, traded) == 50.0
