"""The resistance to the ambient changes: a case covers convection and radiation, a fan or the wind forces the air."""

from ambient_trainer.lti.lag import lagged
from ambient_trainer.simulator.additions import Added, Term
from ambient_trainer.simulator.chamber import coloured
from ambient_trainer.simulator.hidden import Acting, Effect, Figure, Ran, slope
from ambient_trainer.simulator.signals import FULL_WIND_M_S

_CASE_SHADE = 0.5  # share of the change of convection that a case makes in radiation
_FAN_SPIN_UP_S = 15.0
_CASE_FITTING_S = 25.0
_WIND_EXPONENT = 0.6  # of forced convection with the speed


class AmbientCoupling(Effect):
    """A change of the convective resistance."""

    rank = 1
    low, high = -0.9, 9.0
    meaning = "relative change of the convective resistance at 10 K: a case is +, a fan -; at 2 m/s of wind"
    typical = 1.0
    at, everywhere = "surfaces", True
    signals = ("fan_on", "case_on", "wind_m_s")

    def drawn_size(self, typical: float, sign: float, chance: float, signal: str | None) -> float:
        """A fan and the wind cool, a case warms, and without a signal the sign is drawn."""
        cooled = signal in ("fan_on", "wind_m_s") or (signal is None and sign < 0.0)
        return 1.0 / (1.0 + typical) - 1.0 if cooled else typical

    def added(self, acting: Acting, name: str) -> Added:
        """Forced convection where it cools, else less of convection and, by half as much, of radiation."""
        where = acting.device.pattern(dict.fromkeys(acting.covered, 1.0))
        kept = 1.0 / (1.0 + acting.hidden.amount)
        if acting.driver is None:
            course = acting.share()
        elif acting.hidden.signal == "wind_m_s":
            course = (acting.driver / FULL_WIND_M_S) ** _WIND_EXPONENT
        else:
            course = lagged(acting.driver, _FAN_SPIN_UP_S if kept > 1.0 else _CASE_FITTING_S, acting.period_s)
        if kept > 1.0:
            turbulence = 1.0 + 0.05 * coloured(len(course), acting.period_s, 45.0, acting.random())
            return Added((Term("blown", course * turbulence, (kept - 1.0) * where),))
        shaded = _CASE_SHADE * (kept - 1.0)
        return Added((Term("convected", course, (kept - 1.0) * where), Term("radiated", course, shaded * where)))

    def magnitude(self, ran: Ran) -> Figure:
        """Of the conductance that is with the effect, by least squares over the loss that would be without it."""
        with_it, without = (loss[ran.there].sum(axis=1) for loss in ran.losses())
        change = slope(with_it - without, without)
        others = {"conductance_change": (change, "1")}
        if ran.driver is None or str(ran.hidden.signal).endswith("_on"):
            return _resistance(change), "1", others
        per_unit = slope(with_it - without, without * ran.driver[ran.there])
        others["conductance_change_per_unit"] = (per_unit, "1 per m/s")
        others["mean_resistance_change"] = (_resistance(change), "1")
        return _resistance(per_unit), "1 per m/s", others


def _resistance(change: float) -> float:
    """The relative change of a resistance whose conductance changes by ``change`` of itself."""
    return 1.0 / (1.0 + change) - 1.0


EFFECT = AmbientCoupling()
