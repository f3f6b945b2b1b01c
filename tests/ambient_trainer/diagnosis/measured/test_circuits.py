"""What the measured data say without a search for causes: what each circuit leaves, and what a known cause explains.

The bounds are those that a diagnosis of the same data is held to.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from threadpoolctl import threadpool_limits

from ambient_trainer.circuits.circuit import Parameter, Source
from ambient_trainer.circuits.schema import load_circuit
from ambient_trainer.data.grid import segments
from ambient_trainer.data.trace import load_trace
from ambient_trainer.estimation.free_start import FreelyStartingCircuit
from ambient_trainer.estimation.search import search
from ambient_trainer.estimation.uncertainty import residuals


class FitResult(NamedTuple):
    rmse_degC: float
    by_sensor: dict[str, float]
    errors_degC: np.ndarray
    """Of the first sensor."""
    values: dict[str, float]


def fitted(circuit, traces, period_s, starts=1):
    """``circuit`` fitted to ``traces``, each stretch from a state of its own.

    Not by ``fit_circuit``: from a room that nobody logged, a constant, no model of the ambient could be learned.
    """
    columns = [output.column for output in circuit.outputs]
    data = [each for trace in traces for each in segments(trace, circuit.inputs, columns, period_s)]
    structure = FreelyStartingCircuit(circuit, data)
    with threadpool_limits(1):
        best = search(structure, starts, 0).best
        errors = np.concatenate(residuals(structure, best), axis=1)
    by_sensor = {output.name: rms(row) for output, row in zip(circuit.outputs, errors)}
    return FitResult(rms(errors), by_sensor, errors[0], structure.values(best.theta, best.beta))


def rms(errors):
    return float(np.sqrt(np.nanmean(errors**2)))


def with_source(circuit, into, signal, initial):
    share = Parameter("extra", "1", initial, 0.0, 1e3, free=True)
    return replace(
        circuit,
        sources=(*circuit.sources, Source(into, signal, share.name)),
        parameters=(*circuit.parameters, share),
    )


def held(circuit, values, free):
    """``circuit`` with its parameters at ``values``, but for one."""
    return replace(
        circuit,
        parameters=tuple(
            replace(each, initial=values[each.name], free=each.name == free) for each in circuit.parameters
        ),
    )


@pytest.fixture(scope="module")
def houses(measured, circuit):
    """Per house: its trace, the circuit's fit, and the fit with each irradiance as heat into the room."""
    plain = load_circuit(circuit("twinhouse"))
    found = {}
    for house in ("O5", "N2"):
        trace = load_trace(measured(house))
        signals = [name for name in trace.columns if name.startswith("irradiance")]
        suns = {name: fitted(with_source(plain, "living", name, 1.0), [trace], 600.0) for name in signals}
        found[house] = trace, fitted(plain, [trace], 600.0), suns
    return found


def test_the_sun_through_opened_blinds_is_missing_from_the_living_room(houses):
    trace, plain, suns = houses["O5"]
    assert plain.rmse_degC == pytest.approx(1.38, rel=0.05)
    south = trace.columns["irradiance_south_W_m2"]
    assert np.corrcoef(plain.errors_degC, south)[0, 1] == pytest.approx(0.50, abs=0.05)
    assert min(suns, key=lambda name: suns[name].rmse_degC) == "irradiance_south_W_m2"
    assert suns["irradiance_south_W_m2"].rmse_degC == pytest.approx(0.725, rel=0.05)
    assert suns["irradiance_south_W_m2"].values["extra"] == pytest.approx(2.5, rel=0.15)


def test_behind_closed_blinds_the_sun_explains_half_as_much_at_most(houses):
    gains = {
        house: plain.rmse_degC - min(sun.rmse_degC for sun in suns.values())
        for house, (_, plain, suns) in houses.items()
    }
    assert houses["N2"][1].rmse_degC == pytest.approx(0.496, rel=0.05)
    assert 0 < gains["N2"] < 0.5 * gains["O5"]


def test_with_the_sun_both_houses_lose_alike(houses):
    found = {house: suns["irradiance_south_W_m2"].values for house, (_, _, suns) in houses.items()}
    for name in ("C_living", "C_walls", "R_living_ambient"):
        assert found["O5"][name] == pytest.approx(found["N2"][name], rel=0.25)


@pytest.mark.parametrize(
    ("name", "resistance", "factor", "rmse_degC"),
    [
        ("closed", "R_desk_ambient", 1.93, 0.96),
        ("closed_but_for_a_side", "R_desk_ambient", 1.92, 0.76),
        ("holed", "R_desk_ambient", 1.62, 0.62),
        ("fan_in", "R_board_ambient", 0.46, 0.56),
        ("fan_out", "R_board_ambient", 0.52, 0.525),
    ],
)
def test_a_case_and_a_fan_change_the_coupling(measured, circuit, name, resistance, factor, rmse_degC):
    plain = load_circuit(circuit("rpi3-case-fan"))
    naked = fitted(plain, [load_trace(measured("naked"))], 1.0)
    assert naked.rmse_degC == pytest.approx(0.596, rel=0.05)
    trace = load_trace(measured(name))
    one_freed = {
        each.name: fitted(held(plain, naked.values, each.name), [trace], 1.0)
        for each in plain.parameters
        if each.free and each.name != "P_idle"
    }
    found = one_freed.pop(resistance)
    assert found.values[resistance] / naked.values[resistance] == pytest.approx(factor, rel=0.05)
    assert found.rmse_degC == pytest.approx(rmse_degC, rel=0.1)
    assert found.rmse_degC < min(rival.rmse_degC for rival in one_freed.values())
    # the other way into the room comes nearest
    inner = [rival.rmse_degC for name, rival in one_freed.items() if not name.endswith("_ambient")]
    assert found.rmse_degC < 0.8 * min(inner)


def with_heat_signals(trace):
    current = trace.columns["current_A"]
    return replace(trace, columns={**trace.columns, "squared_A2": current**2, "size_A": np.abs(current)})


@pytest.fixture(scope="module")
def cells(measured, circuit):
    """Per run: the fit without heat, with heat by the current squared, and by its size."""
    plain = load_circuit(circuit("lg-m50-cell"))
    found = {}
    for name, period_s in {"cell_0": 60.0, "cell_10": 60.0, "cell_25": 60.0, "cell_2C": 10.0}.items():
        trace = with_heat_signals(load_trace(measured(name)))
        heated = [with_source(plain, "cell", signal, 0.05) for signal in ("squared_A2", "size_A")]
        found[name] = [fitted(each, [trace], period_s, starts=3) for each in (plain, *heated)]
    return found


@pytest.mark.parametrize(
    ("name", "before", "after"),
    [("cell_0", 1.75, 0.43), ("cell_10", 1.44, 0.38), ("cell_25", 1.08, 0.34), ("cell_2C", 9.1, 0.52)],
)
def test_the_current_squared_heats_a_cell(cells, name, before, after):
    plain, squared, _ = cells[name]
    assert (plain.rmse_degC, squared.rmse_degC) == pytest.approx((before, after), rel=0.1)


def test_a_cells_resistance_grows_in_the_cold(cells):
    ohm = [cells[name][1].values["extra"] for name in ("cell_25", "cell_10", "cell_0")]
    assert ohm == pytest.approx([0.018, 0.027, 0.036], rel=0.1)


def test_lamps_in_a_shock_chamber_follow_the_air_but_not_alike(measured, circuit):
    found = fitted(load_circuit(circuit("thermal-shock-chamber")), [load_trace(measured("chamber"))], 10.0)
    assert found.by_sensor == pytest.approx({"ch102": 9.75, "ch105": 3.76, "ch110": 9.0, "ch112": 2.22}, rel=0.05)


def test_a_stuck_zone_is_further_off_than_any_live_one(measured, circuit):
    trace = load_trace(measured("s25"))
    found = fitted(load_circuit(circuit("s25plus-zones")), [trace], 10.0)
    assert found.by_sensor == pytest.approx({"chassis": 1.25, "battery": 3.46, "skin": 4.06}, rel=0.05)
    assert np.nanstd(trace.columns["skin_degC"]) < found.by_sensor["skin"] / 100
