"""The residual heat is the heat that was put in, and the ambient read backward is the one that balances it."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from ambient_trainer.circuits.schema import parse_circuit
from ambient_trainer.data.trace import Trace
from ambient_trainer.diagnosis.forward import forward
from ambient_trainer.diagnosis.greybox.model import GreyBox
from ambient_trainer.diagnosis.greybox.regression import simulate
from ambient_trainer.diagnosis.misfit import misfit_of
from ambient_trainer.diagnosis.record import records_of

PERIOD_S, SAMPLES = 5.0, 1440
TIME_S = PERIOD_S * np.arange(SAMPLES)
C_BOARD, C_SHELL, C_CORE = 12.0, 30.0, 40.0
R_CHIP, R_BETWEEN, R_CORE, R_BOARD, R_SHELL = 4.0, 7.0, 6.0, 15.0, 9.0
HEAT_W = 0.5
ONSET_S = 3000.0
START_DEGC = (34.0, 26.0, 33.0)

CIRCUIT = f"""
format: ambient-circuit
version: 1
name: two
about: A board beside a hot chip, a shell around it, and inside a core that no sensor sees
form: temperature
nodes:
  board: {{capacitance: C_board, sensor: board}}
  shell: {{capacitance: C_shell, sensor: shell}}
  core: {{capacitance: C_core}}
  chip: {{sensor: chip}}
  ambient: {{sensor: ambient}}
edges:
  - {{between: [chip, board], resistance: R_chip}}
  - {{between: [board, shell], resistance: R_between}}
  - {{between: [board, core], resistance: R_core}}
  - {{between: [board, ambient], resistance: R_board}}
  - {{between: [shell, ambient], resistance: R_shell}}
outputs: sensors
parameters:
  C_board: {{unit: J/K, initial: {C_BOARD}, free: FREE}}
  C_shell: {{unit: J/K, initial: {C_SHELL}, free: FREE}}
  C_core: {{unit: J/K, initial: {C_CORE}, free: FREE}}
  R_board: {{unit: K/W, initial: {R_BOARD}}}
  R_shell: {{unit: K/W, initial: {R_SHELL}}}
  R_chip: {{unit: K/W, initial: {R_CHIP}, free: FREE}}
  R_between: {{unit: K/W, initial: {R_BETWEEN}, free: FREE}}
  R_core: {{unit: K/W, initial: {R_CORE}, free: FREE}}
"""
FIXED = CIRCUIT.replace("FREE", "false")
LOOSE = CIRCUIT.replace("FREE", "true")


def chip_degC(time_s):
    return 40.0 + 6.0 * np.sin(2 * np.pi * time_s / 1500.0)


def ambient_degC(time_s):
    return 20.0 + 5.0 * np.sin(2 * np.pi * time_s / 5000.0)


def integrated(heat_board_W, heat_shell_W, core_W_K=0.0):
    """Board and shell, (2, N), integrated from the heat balances as they stand on paper; the core may see the air."""

    def slope(time_s, temps):
        board, shell, core = temps
        between, inward = (shell - board) / R_BETWEEN, (core - board) / R_CORE
        air = ambient_degC(time_s)
        into_board = (chip_degC(time_s) - board) / R_CHIP + between + inward + (air - board) / R_BOARD
        into_shell = -between + (air - shell) / R_SHELL
        return (
            (into_board + heat_board_W(time_s)) / C_BOARD,
            (into_shell + heat_shell_W(time_s)) / C_SHELL,
            (-inward + core_W_K * (air - core)) / C_CORE,
        )

    solved = solve_ivp(slope, (0.0, TIME_S[-1]), START_DEGC, "DOP853", TIME_S, rtol=1e-9, atol=1e-9, max_step=20.0)
    return solved.y[:2]


def seen(board_shell, text=FIXED, noise_degC=0.0, missing=slice(0, 0), **signals):
    random = np.random.default_rng(3)
    board, shell = board_shell + noise_degC * random.standard_normal(board_shell.shape)
    board[missing] = np.nan
    columns = {
        "board_degC": board,
        "shell_degC": shell,
        "chip_degC": chip_degC(TIME_S),
        "ambient_degC": ambient_degC(TIME_S),
        **signals,
    }
    circuit = forward(parse_circuit(text, "two.yaml"))
    model = GreyBox.of(circuit)
    (record,) = records_of(circuit, Trace("two.csv", TIME_S, columns), PERIOD_S)
    z = model.z()[None]
    simulated_degC = simulate(model, record, z, np.array([START_DEGC]))[0]
    return misfit_of(circuit, model.network(record, z), record, simulated_degC)


def nothing(time_s):
    return 0.0 * time_s


def later(time_s):
    return HEAT_W * (time_s > ONSET_S)


@pytest.fixture(scope="module")
def heated():
    return integrated(later, nothing)


@pytest.fixture(scope="module")
def waved():
    return integrated(nothing, lambda time_s: 0.3 * np.sin(2 * np.pi * time_s / 1800.0))


def test_the_heat_that_was_put_in_comes_out_and_the_ambient_that_would_give_it(heated):
    misfit = seen(heated)
    heat = misfit.heat
    well_after, well_before = ONSET_S + 100.0 < TIME_S, TIME_S < ONSET_S - 100.0
    after = well_after & (TIME_S < 6000.0)
    np.testing.assert_allclose(heat[0, after], HEAT_W, atol=0.06)
    assert heat[0, well_after].mean() - heat[0, well_before].mean() == pytest.approx(HEAT_W, abs=0.02)
    assert np.abs(heat[1]).max() < 0.05
    # heat into one of two nodes looks like air that is warmer for both, by as much as moves that heat
    expected = -HEAT_W / (1 / R_BOARD + 1 / R_SHELL)
    np.testing.assert_allclose(misfit.ambient_error_degC[after], expected, atol=0.6)
    assert np.abs(misfit.ambient_error_degC[TIME_S < ONSET_S - 300.0]).max() < 1.0


def test_noise_widens_the_window_until_the_heat_stands_out(heated):
    heat = seen(heated, noise_degC=0.1).heat
    after = TIME_S > ONSET_S + 300.0
    assert heat[0, after].std() < 0.25 * HEAT_W
    assert heat[0, after].mean() - heat[0, TIME_S < ONSET_S - 300.0].mean() == pytest.approx(HEAT_W, rel=0.05)


def test_without_any_power_or_resistance_known_the_heat_is_a_rate(heated):
    rate, watts = seen(heated, LOOSE), seen(heated)
    assert (rate.heat_unit, watts.heat_unit) == ("K/s", "W")
    np.testing.assert_allclose(rate.heat[0] * C_BOARD, watts.heat[0], atol=1e-12)
    np.testing.assert_allclose(rate.heat[1] * C_SHELL, watts.heat[1], atol=1e-12)


def test_a_wrong_reference_is_seen_through_nodes_without_a_sensor():
    edge = "  - {between: [core, ambient], resistance: 5.0}\noutputs:"
    wrong_degC = 2.0 * np.sin(2 * np.pi * TIME_S / 3000.0)
    found = seen(
        integrated(nothing, nothing, core_W_K=1 / 5.0),
        FIXED.replace("outputs:", edge),
        ambient_degC=ambient_degC(TIME_S) + wrong_degC,
    )
    settled = TIME_S > 1500.0  # the core began elsewhere than in equilibrium
    np.testing.assert_allclose(found.ambient_error_degC[settled], wrong_degC[settled], atol=0.1)


def test_nodes_that_meet_no_ambient_or_hardly_tell_none(heated):
    lines = [line for line in FIXED.splitlines() if "ambient]" not in line and "R_board" not in line]
    text = "\n".join(line for line in lines if "R_shell" not in line and "  ambient:" not in line)
    misfit = seen(heated, text)
    assert misfit.ambient_error_degC is None
    assert not any("ambient" in each.name for each in misfit.tests)
    away = FIXED.replace(f"initial: {R_BOARD}", "initial: 1e5").replace(f"initial: {R_SHELL}", "initial: 1e5")
    assert seen(heated, away).ambient_error_degC is None


def test_heat_that_changes_slowly_is_followed_and_what_was_not_measured_spoils_none_elsewhere(waved):
    gap = slice(700, 760)
    whole, holed = seen(waved).heat, seen(waved, missing=gap).heat
    np.testing.assert_allclose(whole[1], 0.3 * np.sin(2 * np.pi * TIME_S / 1800.0), atol=0.04)
    assert np.abs(whole[0]).max() < 0.04
    assert np.isnan(holed[0, gap]).all()
    known = ~np.isnan(holed)
    assert known.sum() == 2 * SAMPLES - 60
    np.testing.assert_allclose(holed[known], whole[known], atol=0.02)
