"""Every cause reads its coefficients with the right unit and sign, knows what physics allows, and joins the circuit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ambient_trainer.circuits.assemble import assemble
from ambient_trainer.diagnosis.candidate import Candidate, Estimate, Setting, Span, per
from ambient_trainer.diagnosis.causes import all_candidates
from ambient_trainer.diagnosis.model import view
from ambient_trainer.diagnosis.setting import setting_of
from ambient_trainer.diagnosis.view import View

N = 300
START = np.array([30.0, 26.0, 22.0])


@pytest.fixture(scope="module")
def seen(chain) -> View:
    inputs = chain.inputs(N)
    on = (np.arange(N) % 100 > 50) * 1.0
    signals = {"camera_on": on, "charge_A": on, "irradiance_W_m2": on, "idle_on": np.zeros(N), "flash_degC": on}
    return view(chain.model(), chain.record(inputs, chain.integrated(inputs, START), **signals))


@pytest.fixture(scope="module")
def setting(chain, seen) -> Setting:
    return setting_of(chain.model(), [seen])


def _named(setting: Setting, cause: str, *, coefficients: int = 1) -> Candidate:
    found = (each for each in all_candidates(setting) if str(each.cause) == cause and len(each.fixed) == coefficients)
    return next(found)


def _found(seen: View, values: list[float], deviations: list[float], of_shape: float = 0.0) -> Estimate:
    return Estimate(seen, np.array(values), np.diag(np.square([*deviations, of_shape])))


TABLE = [
    # cause, coefficients, their deviations, value, unit, interval
    ("heat_source at shell", [0.5], [0.1], 0.5, "W", (0.304, 0.696)),
    ("heat_source at chip by camera_on", [-0.5], [0.1], -0.5, "W", (-0.696, -0.304)),
    ("heat_source at chip by heater_W", [0.5], [0.1], 0.5, "W per W", (0.304, 0.696)),
    ("heat_source at chip by irradiance_W_m2", [2e-3], [1e-3], 2e-3, "W per W/m2", (0.04e-3, 3.96e-3)),
    ("heat_source at board by charge_A", [0.5], [0.1], 0.5, "W per A", (0.304, 0.696)),
    ("ambient_coupling at shell", [1.0], [0.0], -0.5, "1", (-0.5, -0.5)),
    ("ambient_coupling", [-0.5], [0.1], 1.0, "1", (1 / 0.696 - 1, 1 / 0.304 - 1)),
    ("ambient_coupling at board by camera_on", [0.25], [0.0], -0.2, "1", (-0.2, -0.2)),
    ("contact at shell", [0.2, 2.0], [0.0, 0.1], 35.0, "degC", (35 - 0.98, 35 + 0.98)),
    ("contact at chip", [0.1, -1.0], [0.01, 0.0], 15.0, "degC", (15 - 1.96, 15 + 1.96)),
    ("path at chip-shell", [0.05], [0.01], 0.05, "W/K", (0.0304, 0.0696)),
    ("sensor_bias at board", [-1.5], [0.1], -1.5, "degC", (-1.696, -1.304)),
    ("sensor_gain at board", [0.1, 0.4], [0.01, 0.1], 0.1, "1", (0.0804, 0.1196)),
    ("sensor_drift at shell", [1 / 3600], [0.1 / 3600], 1.0, "K/h", (0.804, 1.196)),
]  # fmt: skip


@pytest.mark.parametrize(("cause", "values", "deviations", "value", "unit", "ci95"), TABLE)
def test_magnitudes(setting, seen, cause, values, deviations, value, unit, ci95) -> None:
    candidate = _named(setting, cause, coefficients=len(values))
    found = candidate.magnitude(_found(seen, values, deviations))
    assert found.value == pytest.approx(value)
    assert found.unit == unit
    assert found.ci95 == pytest.approx(ci95)
    assert found.meaning


def test_a_resistance_that_may_be_anything_stays_finite(setting, seen) -> None:
    found = _named(setting, "ambient_coupling at shell").magnitude(_found(seen, [-2.0], [0.1]))
    assert np.isfinite([found.value, *found.ci95]).all()
    assert found.value > 0


def test_a_current_squared_and_in_the_cold(setting, seen) -> None:
    squares = [each for each in all_candidates(setting) if str(each.cause) == "heat_source at board by charge_A"]
    plain, squared, cold = squares
    assert (plain.extend is not None, squared.extend, cold.extend) == (True, None, None)
    assert squared.magnitude(_found(seen, [0.2], [0.1])).unit == "W/A^2"
    assert cold.parameters(_found(seen, [0.2, 0.01], [0.1, 0.1])) == {"growth_per_K": (pytest.approx(0.05), "1/K")}
    np.testing.assert_array_equal(squared.plausible(np.array([[0.1], [-0.1]])), [True, False])
    np.testing.assert_array_equal(
        cold.plausible(np.array([[0.1, 0.1], [0.1, -0.1], [-0.1, 0.1]])), [True, False, False]
    )
    (term,) = squared.terms(seen)
    np.testing.assert_array_equal(term.weight, seen.signal("charge_A") ** 2)


def test_without_a_power_heat_is_told_over_the_capacitance(setting, seen) -> None:
    blind = replace(setting, heat_in_W=False)
    source = _named(blind, "heat_source at shell").magnitude(_found(seen, [0.8], [0.0]))
    assert (source.value, source.unit) == (pytest.approx(0.02), "K/s")
    path = _named(blind, "path at chip-shell").magnitude(_found(seen, [0.05], [0.0]))
    assert (path.value, path.unit) == (pytest.approx(0.005), "1/s")
    held = _named(blind, "contact at shell", coefficients=2).parameters(_found(seen, [0.2, 2.0], [0.0, 0.0]))
    assert held == {"body_temp": (pytest.approx(35.0), "degC"), "conductance": (pytest.approx(0.005), "1/s")}
    mass = next(each for each in all_candidates(blind) if str(each.cause) == "thermal_mass at shell").reshaped(300.0)
    told = mass.magnitude(_found(seen, [0.1], [0.0]))
    assert (told.value, told.unit) == (pytest.approx(30.0 / 40.0), "1")


def test_a_mass_is_conductance_times_time_constant(setting, seen) -> None:
    mass = _named(setting, "thermal_mass at shell").reshaped(300.0)
    told = mass.magnitude(_found(seen, [0.1], [0.01]))
    assert (told.value, told.unit) == (pytest.approx(30.0), "J/K")
    assert told.ci95 == pytest.approx((30 - 5.88, 30 + 5.88))
    # the capacity is a product: by the shape alone, and where both go against each other
    told = mass.magnitude(_found(seen, [0.1], [0.0], 0.2))
    assert told.ci95 == pytest.approx((30 - 1.96 * 6, 30 + 1.96 * 6))
    both = np.array([[0.01**2, -0.01 * 0.1], [-0.01 * 0.1, 0.1**2]])
    assert mass.magnitude(Estimate(seen, np.array([0.1]), both)).ci95 == pytest.approx((30.0, 30.0), abs=1e-5)
    assert mass.parameters(_found(seen, [0.1], [0.01])) == {
        "time_constant": (300.0, "s"), "conductance": (pytest.approx(0.1), "W/K"),
    }  # fmt: skip


def test_lag_and_clock_are_their_shape(setting, seen) -> None:
    lag = _named(setting, "sensor_lag at board").reshaped(120.0)
    told = lag.magnitude(_found(seen, [1.0], [0.0], 0.1))
    assert (told.value, told.unit, told.ci95) == (120.0, "s", pytest.approx((96.48, 143.52)))
    assert lag.fixed == (1.0,)
    assert lag.free == 0
    assert lag.faulty == {1}
    clock = _named(setting, "clock_offset").reshaped(-60.0)
    told = clock.magnitude(_found(seen, [1.0], [0.0], 0.1))
    assert (told.value, told.unit, told.ci95) == (-60.0, "s", pytest.approx((-71.76, -48.24)))


def test_a_reference_logged_late_is_a_positive_offset(seen, setting) -> None:
    """What is logged at t was the ambient t - 60 s: the ambient at t is what is logged 60 s later."""
    (term,) = _named(setting, "clock_offset").reshaped(60.0).terms(seen)
    later = np.append(seen.ambient_degC[6:], np.full(6, seen.ambient_degC[-1]))
    np.testing.assert_allclose(term.weight, later - seen.ambient_degC, atol=1e-12)
    heat = term.heat_W(seen.nodes_degC, seen.ambient_degC, 10.0)
    np.testing.assert_allclose(heat, np.outer([0, 1 / 30, 1 / 15], term.weight), atol=1e-12)


def test_a_quadratic_loss_is_one_power_steeper(setting, seen) -> None:
    """Of D |D| alone the exponent of the loss is two, one more than that of D."""
    bent = _named(setting, "convection_law at shell", coefficients=2)
    told = bent.magnitude(_found(seen, [1.0, -1.0], [0.0, 0.0]))
    assert told.value == pytest.approx(1.0, rel=1e-3)
    assert told.unit == "1"
    none = bent.magnitude(_found(seen, [0.0, 0.3], [0.0, 0.0]))
    assert none.value == pytest.approx(0.0, abs=1e-9)
    half = bent.magnitude(_found(seen, [0.05, 0.0], [0.01, 0.0]))
    assert 0.0 < half.ci95[0] < half.value < half.ci95[1] < 1.0
    assert bent.parameters(_found(seen, [0.05, 0.1], [0, 0])) == {
        "curvature": (0.05, "1/K"), "conductance_change": (0.1, "1"),
    }  # fmt: skip


BOUNDS = [
    ("ambient_coupling at shell", [[-0.5], [5.0], [-3.5]], [True, True, False]),
    ("contact at shell", [[0.1, 1.0], [-0.1, 1.0], [0.1, 4.0], [0.1, -5.0]], [True, False, False, False]),
    ("contact at chip", [[0.0, 0.0]], [False]),
    ("convection_law", [[0.05, 0.0], [0.05, -0.99], [-0.03, 0.0], [-0.01, 0.0]], [True, False, False, True]),
    ("path at chip-shell", [[0.1], [-0.1], [0.0]], [True, False, False]),
    ("sensor_gain at board", [[0.5, 1.0], [-0.95, 0.0]], [True, False]),
    ("thermal_mass at board", [[0.1], [-0.1]], [True, False]),
    ("heat_source at shell", [[-5.0], [np.nan]], [True, False]),
    ("sensor_bias at shell", [[-5.0], [np.inf]], [True, False]),
]  # fmt: skip


@pytest.mark.parametrize(("cause", "values", "wanted"), BOUNDS)
def test_what_physics_allows(setting, cause: str, values: list[list[float]], wanted: list[bool]) -> None:
    candidate = _named(setting, cause, coefficients=len(values[0]))
    np.testing.assert_array_equal(candidate.plausible(np.array(values)), wanted)


def test_places_and_signals(setting) -> None:
    causes = [each.cause for each in all_candidates(setting)]
    signals = {each.signal for each in causes}
    # what never varies drives nothing, and a temperature is no drive
    assert signals == {None, "heater_W", "camera_on", "charge_A", "irradiance_W_m2"}
    assert {each.location for each in causes if each.name == "ambient_coupling"} == {None, "board", "shell"}
    assert {each.location for each in causes if each.name == "path"} == {"chip-shell"}
    assert {each.location for each in causes if each.name.startswith("sensor")} == {"chip", "board", "shell"}
    assert {each.name for each in causes} == {
        "heat_source", "ambient_coupling", "contact", "convection_law", "thermal_mass", "path", "sensor_bias",
        "sensor_gain", "sensor_lag", "sensor_drift", "clock_offset",
    }  # fmt: skip


def test_a_sensor_that_stands_still_is_only_stuck(chain) -> None:
    inputs = chain.inputs(N)
    read = chain.integrated(inputs, START)
    read[1, 100:200] = read[1, 100]
    own = view(chain.model(), chain.record(inputs, read))
    setting = setting_of(chain.model(), [own])
    assert setting.flat[0] is None
    assert setting.flat[2] is None
    onset_s, end_s = setting.flat[1]
    assert onset_s == pytest.approx(1000.0, abs=40.0)
    assert end_s == pytest.approx(1995.0, abs=40.0)
    faults = [each for each in all_candidates(setting) if each.cause.location == "board" and each.faulty]
    assert [each.cause.name for each in faults] == ["sensor_stuck"]
    (stuck,) = faults
    assert stuck.window == setting.flat[1]
    assert stuck.span is Span.WINDOW
    value = float(read[1, 100])
    told = stuck.magnitude(_found(own, [value, 1.0], [0.1, 0.0]))
    assert (told.value, told.unit) == (value, "degC")
    one, minus = stuck.terms(own)
    reading = own.truth_degC[1]
    np.testing.assert_allclose(reading + value * one.law(reading) + minus.law(reading), value)


def test_extensions_are_the_same_heat(chain, setting) -> None:
    """Each circuit that an effect makes has the A and B of the circuit with that heat written down."""
    plain = assemble(chain.circuit, chain.plant().values).value
    C = np.array([10.0, 25.0, 40.0])

    def extended(cause: str, value: float, candidate: Candidate | None = None):
        found = candidate or _named(setting, cause)
        circuit = found.extend(chain.circuit, np.array([value]))
        return circuit, assemble(circuit, {each.name: each.initial for each in circuit.parameters}).value

    circuit, value = extended("heat_source at shell by camera_on", 0.5)
    np.testing.assert_allclose(value.B[:, circuit.inputs.index("camera_on")], [0, 0, 0.5 / 40])
    np.testing.assert_allclose(value.A, plain.A)
    circuit, value = extended("ambient_coupling at shell", 0.5)
    np.testing.assert_allclose(value.A - plain.A, np.diag([0, 0, -0.5 / 15 / 40]), atol=1e-15)
    circuit, value = extended("ambient_coupling", -0.5)
    np.testing.assert_allclose(value.A - plain.A, np.diag([0, 0.5 / 30 / 25, 0.5 / 15 / 40]), atol=1e-15)
    circuit, value = extended("path at chip-shell", 0.05)
    flow = 0.05 * np.array([[-1, 0, 1], [0, 0, 0], [1, 0, -1]]) / C[:, None]
    np.testing.assert_allclose(value.A - plain.A, flow, atol=1e-15)
    circuit, value = extended("", 0.1, _named(setting, "thermal_mass at board").reshaped(300.0))
    assert value.A.shape == (4, 4)
    np.testing.assert_allclose(value.A[3], [0, 1 / 300, 0, -1 / 300], atol=1e-15)
    np.testing.assert_allclose(value.A[1, 1] - plain.A[1, 1], -0.1 / 25)
    for cause in ("contact at shell", "convection_law", "sensor_bias at chip", "heat_source at shell", "clock_offset"):
        assert next(each for each in all_candidates(setting) if str(each.cause) == cause).extend is None


@pytest.mark.parametrize(
    ("signal", "unit"),
    [("wifi_on", "W"), ("cpu_load_frac", "W"), ("sun_W_m2", "W per W/m2"), ("wind_m_s", "W per m/s"),
     ("soc_W", "W per W"),
     ("battery_A", "W per A"), ("usb_V", "W per V"), ("light_lux", "W per lux"), ("counter", "W")],
)  # fmt: skip
def test_units_of_signals(signal: str, unit: str) -> None:
    assert per("W", signal) == unit
