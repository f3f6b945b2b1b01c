"""Heat into a node: a charger that warms up and tapers, a radio that bursts, low sun, an accessory's current."""

import numpy as np

from ambient_trainer.data.trace import Array
from ambient_trainer.lti.lag import lagged
from ambient_trainer.simulator.additions import Added, Term
from ambient_trainer.simulator.chamber import coloured
from ambient_trainer.simulator.hidden import Acting, Effect, Figure, Ran, slope
from ambient_trainer.simulator.signals import FULL_SUN_W_M2

_WARM_UP_S = 45.0  # of a charger's electronics
_TAPER_FROM = 0.6  # share of a charge at constant current, before the constant voltage
_TAPER_S = 1500.0  # at least, of the current then; it falls to a half
_RADIO_SLOT_S = 30.0  # how long a load lasts
_RADIO_TAIL_S = 12.0  # how long a radio stays awake
_LOW_SUN = 0.15  # what the lowest sun loses to reflection


class HeatSource(Effect):
    """Heat that the circuit does not know of."""

    rank = 0
    unit, low, high = "W", 0.0, 10.0
    meaning = "heat while on; at 800 W/m2 of irradiance, or 1 A of current"
    signals = ("radio_on", "charger_on", "irradiance_W_m2", "accessory_current_A")

    def added(self, acting: Acting, name: str) -> Added:
        """One term at one node; a current's follows its square."""
        where = acting.device.pattern({str(acting.hidden.location): acting.hidden.amount})
        if acting.hidden.signal == "accessory_current_A":
            current = np.where(acting.lasts, acting.signals[acting.hidden.signal], 0.0)
            return Added((Term("ohmic", current**2, where),))
        course = {"radio_on": _radio, "irradiance_W_m2": _sunshine}.get(acting.hidden.signal or "", _charger)
        return Added((Term("steady", course(acting), where),))

    def magnitude(self, ran: Ran) -> Figure:
        """Mean heat, or heat per unit of what drives it, by least squares."""
        into = ran.heat(ran.added).sum(axis=1)[ran.there]
        signal = ran.hidden.signal
        mean_W = (float(into.mean()), "W")
        if ran.driver is None or signal is None or signal.endswith("_on"):
            return *mean_W, {"peak_W": (float(into.max()), "W")}
        logged = ran.driver[ran.there]
        if signal.endswith("_A"):
            return slope(into, logged**2), "W/A^2", {"mean_W": mean_W, "at_25_degC": (ran.hidden.amount, "W/A^2")}
        return slope(into, logged), "W per W/m2", {"mean_W": mean_W}


def _charger(acting: Acting) -> Array:
    """Warms up, holds, tapers when the cell is nearly full; an interruption starts the taper again."""
    if acting.driver is None:
        on, (start_s, end_s) = acting.lasts, acting.lasting
        length_s = end_s - start_s
    else:
        on = acting.driver > 0.5
        length_s = acting.period_s * on.sum() / max(np.sum(np.diff(on.astype(int)) == 1), 1)
    begun = np.maximum.accumulate(np.where(on & ~np.r_[False, on[:-1]], acting.time_s, -np.inf))
    elapsed_s = np.where(on, acting.time_s - begun, 0.0)
    late_s = np.maximum(elapsed_s - _TAPER_FROM * length_s, 0.0)
    taper = 0.5 + 0.5 * np.exp(-late_s / max(0.5 * length_s, _TAPER_S))
    ripple = 1.0 + 0.03 * coloured(len(on), acting.period_s, 90.0, acting.random())
    return on * (1.0 - np.exp(-elapsed_s / _WARM_UP_S)) * taper * np.maximum(ripple, 0.0)


def _radio(acting: Acting) -> Array:
    """Bursts: every half a minute another load; after the last, the radio stays awake for a moment."""
    slot = ((acting.time_s - acting.time_s[0]) / _RADIO_SLOT_S).astype(np.intp)
    load = acting.random().uniform(0.5, 1.5, int(slot[-1]) + 1)[slot]
    return np.maximum(lagged(acting.signals["radio_on"] * load, _RADIO_TAIL_S, acting.period_s), 0.0)


def _sunshine(acting: Acting) -> Array:
    """Low sun is reflected more than high: the absorptance grows with the irradiance, the glass takes its time."""
    share = acting.signals["irradiance_W_m2"] / FULL_SUN_W_M2
    return np.maximum(lagged(share * (1.0 - _LOW_SUN * (1.0 - share)), 20.0, acting.period_s), 0.0)


EFFECT = HeatSource()
