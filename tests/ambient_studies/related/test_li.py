"""Li's circuit: the fixed point against a root finder, and a world made by the circuit's differential equation."""

from dataclasses import astuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline
from scipy.optimize import brentq

from ambient_studies.related import li
from ambient_trainer.data.trace import Trace

TRUTH = li.Surface(
    usb_share=0.4, battery=0.8, flash=0.3, soc=0.03, own_heat_K=0.4, storage_s=500.0, convection=0.6, lag_s=5.0
)


@given(
    surface=st.floats(-60.0, 120.0),
    heat=st.floats(-500.0, 500.0) | st.sampled_from([0.0, 1e-300, -1e-12]),
    convection=st.floats(0.0, 1000.0),
)
def test_the_fixed_point_is_the_root(surface: float, heat: float, convection: float) -> None:
    def balance(y: float) -> float:
        return (1.0 + convection * abs(y) ** 0.25) * y - heat

    found = li.fixed_point(np.array([surface]), np.array([heat]), convection)

    reach = abs(heat) + 1.0
    assert found[0] == pytest.approx(surface - brentq(balance, -reach, reach, xtol=1e-13), abs=1e-9)


def test_samples_do_not_depend_on_each_other() -> None:
    rng = np.random.default_rng(1)
    surface, heat = rng.uniform(-20.0, 60.0, 200), rng.uniform(-40.0, 40.0, 200)

    together = li.fixed_point(surface, heat, 0.7)

    alone = [li.fixed_point(surface[k : k + 1], heat[k : k + 1], 0.7)[0] for k in range(200)]
    assert np.array_equal(together, alone)


def test_what_does_not_settle_is_no_number() -> None:
    # a loss that falls with the difference is no circuit, and the iteration wanders
    found = li.fixed_point(np.array([20.0, 20.0]), np.array([5.0, 0.0]), -0.5)

    assert np.isnan(found[0])
    assert found[1] == 20.0


def world(seed: int, samples: int = 8000, period_s: float = 2.0) -> Trace:
    """Sensors whose surface obeys the circuit with the parameters TRUTH, its lag apart, read to 0.002 degC."""
    rng = np.random.default_rng(seed)
    time_s = np.arange(samples) * period_s
    knots_s = np.linspace(0.0, time_s[-1], 30)
    ambient, battery, flash, soc, tilt = (
        CubicSpline(knots_s, level + spread * rng.uniform(-1.0, 1.0, 30))
        for level, spread in [(15.0, 15.0), (25.0, 12.0), (30.0, 15.0), (50.0, 30.0), (0.0, 2.0)]
    )

    def slope(t: float, surface: np.ndarray) -> np.ndarray:
        arriving = sum(
            share * (hot(t) - surface)
            for share, hot in [(TRUTH.battery, battery), (TRUTH.flash, flash), (TRUTH.soc, soc)]
        )
        y = surface - ambient(t)
        return (TRUTH.own_heat_K + arriving - (1.0 + TRUTH.convection * np.abs(y) ** 0.25) * y) / TRUTH.storage_s

    surface = solve_ivp(slope, (0.0, time_s[-1]), [20.0], t_eval=time_s, rtol=1e-8, atol=1e-8).y[0]
    true = {
        "usb_degC": surface + (1.0 - TRUTH.usb_share) * tilt(time_s),
        "display_degC": surface - TRUTH.usb_share * tilt(time_s),
        "battery_degC": battery(time_s),
        "flash_degC": flash(time_s),
        "soc_degC": soc(time_s),
    }
    read = {name: values + rng.normal(0.0, 0.002, samples) for name, values in true.items()}
    return Trace(f"circuit {seed}", time_s, {**read, "ambient_degC": ambient(time_s)})


def test_a_world_of_the_circuit_comes_back() -> None:
    found = li.fit(world(1))

    # the derivative's lag, at least 5 s, makes the little that is missing
    assert astuple(found)[:4] == pytest.approx(astuple(TRUTH)[:4], rel=0.05, abs=0.003)
    assert found.own_heat_K == pytest.approx(TRUTH.own_heat_K, abs=0.2)
    assert found.storage_s == pytest.approx(TRUTH.storage_s, rel=0.05)
    assert found.convection == pytest.approx(TRUTH.convection, rel=0.1)
    unseen = world(2)
    error = found.estimate(unseen) - unseen.reference
    assert np.sqrt(np.mean(error[60:] ** 2)) < 0.15


def test_at_rest_the_ambient_is_the_root_of_the_steady_balance() -> None:
    rows = np.repeat([[30.0], [32.0], [36.0], [40.0], [60.0]], 50, axis=1)
    columns = dict(zip(li.SENSORS, rows))

    found = TRUTH.estimate(Trace("rest", np.arange(50.0), columns))

    surface = 0.4 * 30.0 + 0.6 * 32.0
    heat = 0.4 + 0.8 * (36.0 - surface) + 0.3 * (40.0 - surface) + 0.03 * (60.0 - surface)
    rise = brentq(lambda y: (1.0 + 0.6 * y**0.25) * y - heat, 0.0, 50.0, xtol=1e-13)
    assert found == pytest.approx(np.full(50, surface - rise), abs=1e-8)
