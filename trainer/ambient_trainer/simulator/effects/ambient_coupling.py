"""The resistance to the ambient changes: a case covers convection and radiation, a fan or the wind forces the air."""

import numpy as np

from ambient_trainer.lti.lag import lagged
from ambient_trainer.simulator.additions import Added, Term
from ambient_trainer.simulator.chamber import coloured
from ambient_trainer.simulator.hidden import Figure, Hidden, Ran, Setting, SurfaceEffect, slope
from ambient_trainer.simulator.signals import FULL_WIND_M_S

_CASE_SHADE = 0.5  # share of the change of convection that a case makes in radiation
_FAN_SPIN_UP_S = 15.0
_CASE_FITTING_S = 25.0
_WIND_EXPONENT = 0.6  # of forced convection with the speed


class AmbientCoupling(SurfaceEffect):
    """A change of the convective resistance."""

    rank = 1
    low, high = -0.9, 9.0
    meaning = "relative change of the convective resistance at 10 K: a case is +, a fan -; at 2 m/s of wind"
    typical = 1.0
    signals = ("fan_on", "case_on", "wind_m_s")

    def drawn_size(self, typical: float, sign: float, chance: float, signal: str | None) -> float:
        """A fan and the wind cool, a case warms, and without a signal the sign is drawn."""
        cooled = signal in ("fan_on", "wind_m_s") or (signal is None and sign < 0.0)
        return 1.0 / (1.0 + typical) - 1.0 if cooled else typical

    def added(self, hidden: Hidden, setting: Setting, name: str, random: np.random.Generator) -> Added:
        """Forced convection where it cools, else less of convection and, by half as much, of radiation."""
        where = setting.device.pattern(dict.fromkeys(setting.device.covered(hidden.location), 1.0))
        kept = 1.0 / (1.0 + hidden.amount)
        if hidden.signal is None:
            course = setting.share(hidden)
        elif hidden.signal == "wind_m_s":
            course = (setting.signals[hidden.signal] / FULL_WIND_M_S) ** _WIND_EXPONENT
        else:
            lag_s = _FAN_SPIN_UP_S if kept > 1.0 else _CASE_FITTING_S
            course = lagged(setting.signals[hidden.signal], lag_s, setting.period_s)
        if kept > 1.0:
            turbulence = 1.0 + 0.05 * coloured(len(course), setting.period_s, 45.0, random)
            return Added((Term("blown", course * turbulence, (kept - 1.0) * where),))
        shaded = _CASE_SHADE * (kept - 1.0)
        return Added((Term("convected", course, (kept - 1.0) * where), Term("radiated", course, shaded * where)))

    def magnitude(self, ran: Ran) -> Figure:
        """Of the conductance that is with the effect, by least squares over the loss that would be without it."""
        with_it, without = (loss[ran.there].sum(axis=1) for loss in ran.losses())
        change = slope(with_it - without, without)
        others = {"conductance_change": (change, "1")}
        if ran.hidden.signal is None or ran.hidden.signal.endswith("_on"):
            return _resistance(change), "1", others
        per_unit = slope(with_it - without, without * ran.setting.signals[ran.hidden.signal][ran.there])
        others["conductance_change_per_unit"] = (per_unit, "1 per m/s")
        others["mean_resistance_change"] = (_resistance(change), "1")
        return _resistance(per_unit), "1 per m/s", others


def _resistance(change: float) -> float:
    """The relative change of a resistance whose conductance changes by ``change`` of itself."""
    return 1.0 / (1.0 + change) - 1.0


EFFECT = AmbientCoupling()
