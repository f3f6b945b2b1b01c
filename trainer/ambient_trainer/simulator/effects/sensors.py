"""The physics of hidden instrument faults: they come within a minute or so, bend, flicker and skew, as real ones do."""

from __future__ import annotations

from collections.abc import Callable, Container, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ambient_trainer.lti.lag import lagged
from ambient_trainer.simulator.effects.effect import Hidden
from ambient_trainer.simulator.effects.physics import Setting
from ambient_trainer.simulator.instruments import Sound

Array = NDArray[np.float64]

GAIN_REFERENCE_DEGC = 25.0
_BENT_PER_K = 1e-3  # the gain's own change
_LAGS = (0.7, 0.3)  # shares of the delay
_FLICKERS = 0.02  # share of the samples
_DRIFT_POWER = 1.15  # of the time since it began
_SKEW = 5e-5  # s per s: a bad crystal
_DRIFT_UNIT_S = 3600.0


@dataclass(frozen=True)
class Ailing(Sound):
    """What the hidden faults of a run make of what its instruments feel, read and when; each once a run."""

    effects: Sequence[Hidden]
    setting: Setting
    random: Callable[[Hidden], np.random.Generator]
    """An effect's own random numbers, from their beginning."""

    def felt(self, zone: str, felt_degC: Array) -> Array:
        """What ``zone``'s sensor has itself as temperature, shape (n,)."""
        for effect in self._of(zone, _FELT):
            felt_degC = _FELT[effect.cause](effect, self.setting, felt_degC, self.random(effect))
        return felt_degC

    def read(self, zone: str, reading_degC: Array, step_degC: float) -> Array:
        """What ``zone`` reports, shape (n,), in steps of ``step_degC``."""
        for effect in self._of(zone, ("sensor_stuck",)):
            reading_degC = _stuck(effect, self.setting, reading_degC, step_degC, self.random(effect))
        return reading_degC

    def air(self, air_degC: Array) -> Array:
        """The air that the reference's record says there was, shape (n,); beyond its ends as at them."""
        for effect in self.effects:
            if effect.cause == "clock_offset":
                ahead_s = clock_ahead(effect, self.setting, self.random(effect))
                air_degC = np.interp(self.setting.time_s - ahead_s, self.setting.time_s, air_degC)
        return air_degC

    def _of(self, zone: str, causes: Container[str]) -> list[Hidden]:
        return [effect for effect in self.effects if effect.location == zone and effect.cause in causes]


def clock_ahead(hidden: Hidden, setting: Setting, random: np.random.Generator) -> Array:
    """How far the reference's clock is ahead of the device's, in s, shape (n,): what it stamps t happened before t.

    The reference's column then lags what the device feels.
    """
    skew = random.choice([-1.0, 1.0]) * _SKEW
    middle_s = np.mean(setting.lasting(hidden))
    if not hidden.amount:
        return np.zeros_like(setting.time_s)
    return np.where(setting.lasts(hidden), hidden.amount + skew * (setting.time_s - middle_s), 0.0)


def drifted_h(hidden: Hidden, setting: Setting) -> Array:
    """How long a sensor drifts, in h, bent: slow at first, shape (n,)."""
    start_s, end_s = setting.lasting(hidden)
    passed_s = np.clip(setting.time_s - start_s, 0.0, end_s - start_s)
    bent = (passed_s / (end_s - start_s)) ** _DRIFT_POWER * (end_s - start_s)
    return bent / _DRIFT_UNIT_S


_Fault = Callable[[Hidden, Setting, Array, np.random.Generator], Array]


def _bias(hidden: Hidden, setting: Setting, felt_degC: Array, _: np.random.Generator) -> Array:
    return felt_degC + hidden.amount * setting.share(hidden, 90.0)


def _gain(hidden: Hidden, setting: Setting, felt_degC: Array, _: np.random.Generator) -> Array:
    from_reference = felt_degC - GAIN_REFERENCE_DEGC
    bent = hidden.amount * from_reference * (1.0 + _BENT_PER_K * from_reference)
    return felt_degC + setting.share(hidden) * bent


def _lag(hidden: Hidden, setting: Setting, felt_degC: Array, _: np.random.Generator) -> Array:
    """Two lags, one behind the other, as through grease and a housing."""
    late = felt_degC
    for share in _LAGS if hidden.amount else ():
        late = lagged(late, share * hidden.amount, setting.period_s)
    return felt_degC + setting.share(hidden) * (late - felt_degC)


def _drift(hidden: Hidden, setting: Setting, felt_degC: Array, _: np.random.Generator) -> Array:
    return felt_degC + hidden.amount * np.where(setting.lasts(hidden), drifted_h(hidden, setting), 0.0)


_FELT: dict[str, _Fault] = {
    "sensor_bias": _bias,
    "sensor_gain": _gain,
    "sensor_lag": _lag,
    "sensor_drift": _drift,
}


def _stuck(
    hidden: Hidden, setting: Setting, reading_degC: Array, step_degC: float, random: np.random.Generator
) -> Array:
    """One value, but that its last digit flickers now and then."""
    sticking = setting.lasts(hidden)
    value = hidden.size if hidden.size is not None else reading_degC[int(np.argmax(sticking))]
    flicker = random.choice([-1.0, 1.0], len(reading_degC)) * (random.random(len(reading_degC)) < _FLICKERS)
    stuck = np.round((np.round(value / step_degC) + flicker) * step_degC, 6)
    return np.where(sticking, stuck, reading_degC)
