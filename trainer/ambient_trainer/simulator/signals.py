"""What is logged beside the temperatures: signals that drive an effect, and decoys, which drive nothing.

A signal is zero outside its window; both are drawn from the run's seed by their names, whatever else is hidden.
"""

from collections.abc import Callable
from functools import partial

import numpy as np

from ambient_trainer.data.trace import Array
from ambient_trainer.lti.lag import lagged
from ambient_trainer.simulator.chamber import coloured

Drawn = Callable[[Array, tuple[float, float], np.random.Generator], Array]
"""From times and a window to a signal."""
FULL_SUN_W_M2 = 800.0
FULL_WIND_M_S = 2.0
_CLOUDS_S = 400.0
_GUSTS_S = 120.0


def signal(name: str, time_s: Array, window: tuple[float, float], random: np.random.Generator) -> Array:
    """The column ``name`` at ``time_s``, shape (n,), evenly spaced; zero outside ``window``, in s."""
    inside = (time_s >= window[0] - 1e-9) & (time_s < window[1] - 1e-9)
    return np.where(inside, _DRAWN[name](time_s, window, random), 0.0)


def switched(time_s: Array, window: tuple[float, float], random: np.random.Generator, minutes: float) -> Array:
    """The number of the session that is on, from 1; 0 while off; they last 0.5 to 1.5 times ``minutes``, on and off.

    The first begins within two minutes; in a window that is short for them they are shorter.
    """
    typical_s = min(60.0 * minutes, (window[1] - window[0]) / 5.0)
    most_sessions = int((window[1] - window[0]) / (0.5 * typical_s)) + 2
    lasting_s = typical_s * random.uniform(0.5, 1.5, 2 * most_sessions)
    lasting_s[0] = random.uniform(0.0, min(120.0, typical_s))
    changes_s = window[0] + np.cumsum(lasting_s)
    passed = np.searchsorted(changes_s, time_s, side="right")
    return np.where(passed % 2 == 1, (passed + 1) // 2, 0).astype(np.float64)


def _on(time_s: Array, window: tuple[float, float], random: np.random.Generator, minutes: float) -> Array:
    return (switched(time_s, window, random, minutes) > 0).astype(np.float64)


def _sun(time_s: Array, window: tuple[float, float], random: np.random.Generator) -> Array:
    """The arc of a bright day, with clouds that come and go within minutes."""
    way = np.clip((time_s - window[0]) / (window[1] - window[0]), 0.0, 1.0)
    clear = FULL_SUN_W_M2 * (0.35 + 0.65 * np.sin(np.pi * way))
    covered = 1.0 / (1.0 + np.exp(-4.0 * (_coloured(time_s, _CLOUDS_S, random) - 0.4)))
    return np.round(clear * (1.0 - 0.8 * covered), 1)


def _current(time_s: Array, window: tuple[float, float], random: np.random.Generator) -> Array:
    session = switched(time_s, window, random, 12.0).astype(np.intp)
    levels = np.concatenate([[0.0], random.uniform(0.5, 1.5, int(session.max(initial=0)) + 1)])
    ripple = 1.0 + 0.03 * _coloured(time_s, 30.0, random)
    return np.round(levels[session] * np.maximum(ripple, 0.5), 3)


def _wind(time_s: Array, _: tuple[float, float], random: np.random.Generator) -> Array:
    slow, gusts = _coloured(time_s, 900.0, random), _coloured(time_s, _GUSTS_S, random)
    return np.round(FULL_WIND_M_S * np.exp(0.45 * slow + 0.3 * gusts - 0.15), 2)


def _coloured(time_s: Array, correlation_s: float, random: np.random.Generator) -> Array:
    """First-order noise of unit variance in steps of at least a second, so that its course is a smooth one."""
    period_s = float(time_s[1] - time_s[0]) if len(time_s) > 1 else 1.0
    rough = coloured(len(time_s), period_s, correlation_s, random)
    return lagged(rough, correlation_s / 5.0, period_s)


_DRAWN: dict[str, Drawn] = {
    "radio_on": partial(_on, minutes=9.0),
    "charger_on": partial(_on, minutes=25.0),
    "irradiance_W_m2": _sun,
    "accessory_current_A": _current,
    "fan_on": partial(_on, minutes=20.0),
    "case_on": partial(_on, minutes=30.0),
    "wind_m_s": _wind,
    "wifi_on": partial(_on, minutes=12.0),
    "gps_on": partial(_on, minutes=20.0),
    "light_lux": lambda time_s, _, random: np.round(300.0 * np.exp(1.2 * _coloured(time_s, 1200.0, random)), 0),
    "pressure_hPa": lambda time_s, _, random: np.round(1013.0 + 1.5 * _coloured(time_s, 7200.0, random), 2),
}

SIGNALS = tuple(_DRAWN)
