"""The physics of hidden heat: richer than what a diagnosis assumes, so that none of it is a candidate's own equation.

A charger warms up and tapers, a radio bursts, the sun stands low; a case covers, a fan's air is forced; a hand has
blood, an accessory layers, a strap a mass of its own. Whatever is on is so at samples, and slews in.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ambient_trainer.lti.lag import lagged
from ambient_trainer.simulator.additions import AIR, Added, Body, Link, Term
from ambient_trainer.simulator.chamber import coloured
from ambient_trainer.simulator.constants import NODES, SURFACE_M2
from ambient_trainer.simulator.effects.effect import Hidden
from ambient_trainer.simulator.effects.signals import FULL_SUN_W_M2, FULL_WIND_M_S

Array = NDArray[np.float64]

SLEW_S = 60.0
"""From an onset on, until an effect that comes is all there."""
SHELL = ("back", "frame")
"""What a case covers and a hand holds where it is about the back."""

_WARM_UP_S = 45.0  # of a charger's electronics
_TAPER_FROM = 0.6  # share of a charge at constant current, before the constant voltage
_TAPER_S = 1500.0  # at least, of the current then; it falls to a half
_RADIO_SLOT_S = 30.0  # how long a load lasts
_RADIO_TAIL_S = 12.0  # how long a radio stays awake
_LOW_SUN = 0.15  # what the lowest sun loses to reflection
_CASE_SHADE = 0.5  # share of the change of convection that a case makes in radiation
_FAN_SPIN_UP_S = 15.0
_CASE_FITTING_S = 25.0
_WIND_EXPONENT = 0.6  # of forced convection with the speed
_LAYERS = (0.45, 0.35, 0.2)  # shares of an accessory's capacitance, from the phone outward
_LAYERED_S = 45.0  # its capacitance over the conductance to the phone
_CLAMP_W_K = 0.3  # at most, that conductance
_OWN_LOSS_W_K_PER_J_K = 1e-4  # to the air
_APART_S = 120.0  # how fast what is not attached follows the air
_STRAP_S = 12.0  # a strap's capacitance over its conductance
_LEAST_STRAP_J_K = 1.0


@dataclass(frozen=True)
class Setting:
    """What an effect meets: n samples, from before the recording's 0 s on; signals by column, shape (n,)."""

    time_s: Array
    period_s: float
    signals: Mapping[str, Array]

    def lasting(self, hidden: Hidden) -> tuple[float, float]:
        """From and to; what lasts since ever does so before the recording, too."""
        end_s = float(self.time_s[-1]) + self.period_s
        start_s = float(self.time_s[0]) if hidden.onset_s <= 0.0 else hidden.onset_s
        return start_s, end_s if hidden.end_s is None else min(hidden.end_s, end_s)

    def lasts(self, hidden: Hidden) -> NDArray[np.bool_]:
        """When an effect that comes and goes at once is there."""
        start_s, end_s = self.lasting(hidden)
        return (self.time_s >= start_s - 1e-9) & (self.time_s < end_s - 1e-9)

    def share(self, hidden: Hidden, slew_s: float = SLEW_S) -> Array:
        """How much of an effect is there, 0 to 1: it comes and goes smoothly, or is there since ever."""
        start_s, _ = self.lasting(hidden)
        came = np.ones_like(self.time_s) if hidden.onset_s <= 0.0 else _smooth((self.time_s - start_s) / slew_s)
        gone = 0.0 if hidden.end_s is None else _smooth((self.time_s - hidden.end_s) / slew_s)
        return came * (1.0 - gone)


def added(hidden: Hidden, setting: Setting, number: int, random: np.random.Generator) -> Added:
    """What ``hidden`` adds to a run's heat balance; nothing, where it is in the instruments or of size zero.

    ``number`` tells its bodies from another effect's.
    """
    if hidden.cause not in _PHYSICS or not hidden.amount:
        return Added()
    return _PHYSICS[hidden.cause](hidden, setting, f"effect {number}", random)


def affected(location: str | None) -> tuple[str, ...]:
    """The surfaces that an effect on the outside is about."""
    if location is None:
        return tuple(SURFACE_M2)
    return SHELL if location == "back" else (location,)


def pattern(nodes: Mapping[str, float]) -> Array:
    """Shape (nodes,)."""
    return np.array([nodes.get(node, 0.0) for node in NODES])


def _heat_source(hidden: Hidden, setting: Setting, _: str, random: np.random.Generator) -> Added:
    where = pattern({str(hidden.location): hidden.amount})
    if hidden.signal == "accessory_current_A":
        current = np.where(setting.lasts(hidden), setting.signals[hidden.signal], 0.0)
        return Added((Term("ohmic", current**2, where),))
    course = {
        None: _charger,
        "charger_on": _charger,
        "radio_on": _radio,
        "irradiance_W_m2": _sunshine,
    }[hidden.signal](hidden, setting, random)
    return Added((Term("steady", course, where),))


def _charger(hidden: Hidden, setting: Setting, random: np.random.Generator) -> Array:
    """Warms up, holds, tapers when the cell is nearly full; an interruption starts the taper again."""
    if hidden.signal is None:
        on = setting.lasts(hidden)
        length_s = setting.lasting(hidden)[1] - setting.lasting(hidden)[0]
    else:
        on = setting.signals[hidden.signal] > 0.5
        length_s = setting.period_s * on.sum() / max(np.sum(np.diff(on.astype(int)) == 1), 1)
    begun = np.maximum.accumulate(np.where(on & ~np.r_[False, on[:-1]], setting.time_s, -np.inf))
    elapsed_s = np.where(on, setting.time_s - begun, 0.0)
    late_s = np.maximum(elapsed_s - _TAPER_FROM * length_s, 0.0)
    taper = 0.5 + 0.5 * np.exp(-late_s / max(0.5 * length_s, _TAPER_S))
    ripple = 1.0 + 0.03 * coloured(len(on), setting.period_s, 90.0, random)
    return on * (1.0 - np.exp(-elapsed_s / _WARM_UP_S)) * taper * np.maximum(ripple, 0.0)


def _radio(hidden: Hidden, setting: Setting, random: np.random.Generator) -> Array:
    """Bursts: every half a minute another load; after the last, the radio stays awake for a moment."""
    on = setting.signals["radio_on"]
    slot = ((setting.time_s - setting.time_s[0]) / _RADIO_SLOT_S).astype(np.intp)
    load = random.uniform(0.5, 1.5, int(slot[-1]) + 1)[slot]
    return np.maximum(lagged(on * load, _RADIO_TAIL_S, setting.period_s), 0.0)


def _sunshine(hidden: Hidden, setting: Setting, _: np.random.Generator) -> Array:
    """Low sun is reflected more than high: the absorptance grows with the irradiance, the glass takes its time."""
    share = setting.signals["irradiance_W_m2"] / FULL_SUN_W_M2
    return np.maximum(lagged(share * (1.0 - _LOW_SUN * (1.0 - share)), 20.0, setting.period_s), 0.0)


def _ambient_coupling(hidden: Hidden, setting: Setting, _: str, random: np.random.Generator) -> Added:
    where = pattern(dict.fromkeys(affected(hidden.location), 1.0))
    kept = 1.0 / (1.0 + hidden.amount)
    if hidden.signal is None:
        course = setting.share(hidden)
    else:
        logged = setting.signals[hidden.signal]
        if hidden.signal == "wind_m_s":
            course = (logged / FULL_WIND_M_S) ** _WIND_EXPONENT
        else:
            course = lagged(logged, _FAN_SPIN_UP_S if kept > 1.0 else _CASE_FITTING_S, setting.period_s)
    if kept > 1.0:
        turbulence = 1.0 + 0.05 * coloured(len(course), setting.period_s, 45.0, random)
        return Added((Term("blown", course * turbulence, (kept - 1.0) * where),))
    shaded = _CASE_SHADE * (kept - 1.0)
    return Added((Term("convected", course, (kept - 1.0) * where), Term("radiated", course, shaded * where)))


def _contact(hidden: Hidden, setting: Setting, name: str, random: np.random.Generator) -> Added:
    grip = 1.0 + 0.15 * lagged(coloured(len(setting.time_s), setting.period_s, 120.0, random), 15.0, setting.period_s)
    conductance = hidden.amount * setting.share(hidden) * np.clip(grip, 0.3, 1.7)
    steady = np.ones_like(setting.time_s)
    bodies, links = _BODIES[hidden.body or "hand"](name, steady, random)
    areas = {node: SURFACE_M2[node] for node in affected(hidden.location)}
    shares = {node: area / sum(areas.values()) for node, area in areas.items()}
    touching = [Link(bodies[0].name, node, share * conductance) for node, share in shares.items()]
    return Added((), bodies, (*touching, *links))


def _hand(name: str, steady: Array, random: np.random.Generator) -> tuple[tuple[Body, ...], tuple[Link, ...]]:
    """Skin that blood keeps near the core's temperature and the air cools."""
    skin = Body(f"{name} skin", 45.0)
    blood = Body(f"{name} blood", np.inf, random.uniform(35.0, 37.0))
    return (skin, blood), (Link(skin.name, blood.name, 3.0 * steady), Link(skin.name, AIR, 0.08 * steady))


def _pocket(name: str, steady: Array, random: np.random.Generator) -> tuple[tuple[Body, ...], tuple[Link, ...]]:
    """Cloth between the phone and a thigh."""
    cloth = Body(f"{name} cloth", 25.0)
    thigh = Body(f"{name} thigh", np.inf, random.uniform(32.0, 34.5))
    return (cloth, thigh), (Link(cloth.name, thigh.name, 1.8 * steady), Link(cloth.name, AIR, 0.12 * steady))


def _table(name: str, steady: Array, random: np.random.Generator) -> tuple[tuple[Body, ...], tuple[Link, ...]]:
    """A stone top on a cold slab."""
    top = Body(f"{name} top", 300.0)
    slab = Body(f"{name} slab", np.inf, random.uniform(8.0, 14.0))
    return (top, slab), (Link(top.name, slab.name, 4.0 * steady), Link(top.name, AIR, 0.3 * steady))


_BODIES = {"hand": _hand, "pocket": _pocket, "table": _table}


def _convection_law(hidden: Hidden, setting: Setting, _: str, random: np.random.Generator) -> Added:
    where = pattern(dict.fromkeys(affected(hidden.location), hidden.amount))
    unsteady = 1.0 + 0.05 * coloured(len(setting.time_s), setting.period_s, 60.0, random)
    return Added((Term("draught", setting.share(hidden) * unsteady, where),))


def _thermal_mass(hidden: Hidden, setting: Setting, name: str, _: np.random.Generator) -> Added:
    attached = setting.share(hidden, 20.0)
    clamp = min(hidden.amount / _LAYERED_S, _CLAMP_W_K)
    layers = [Body(f"{name} layer {k}", share * hidden.amount) for k, share in enumerate(_LAYERS)]
    names = [str(hidden.location), *(layer.name for layer in layers)]
    between = [attached * clamp, *[np.full_like(attached, 2.5 * clamp)] * (len(layers) - 1)]
    inner = [Link(one, other, flow) for one, other, flow in zip(names, names[1:], between)]
    apart = [
        Link(layer.name, AIR, _apart(attached, layer.capacity_J_K) + _OWN_LOSS_W_K_PER_J_K * layer.capacity_J_K)
        for layer in layers
    ]
    return Added((), tuple(layers), (*inner, *apart))


def _path(hidden: Hidden, setting: Setting, name: str, _: np.random.Generator) -> Added:
    clamped = setting.share(hidden, 30.0)
    strap = Body(f"{name} strap", max(_STRAP_S * hidden.amount, _LEAST_STRAP_J_K))
    ends = str(hidden.location).split("-")
    halves = [Link(strap.name, end, 2.0 * hidden.amount * clamped) for end in ends]
    return Added((), (strap,), (*halves, Link(strap.name, AIR, _apart(clamped, strap.capacity_J_K))))


def _apart(attached: Array, capacity_J_K: float) -> Array:
    return np.maximum(1.0 - attached, 0.0) * capacity_J_K / _APART_S


def _smooth(way: Array) -> Array:
    """0 up to 0, 1 from 1 on."""
    return 0.5 - 0.5 * np.cos(np.pi * np.clip(way, 0.0, 1.0))


_PHYSICS: dict[str, Callable[[Hidden, Setting, str, np.random.Generator], Added]] = {
    "heat_source": _heat_source,
    "ambient_coupling": _ambient_coupling,
    "contact": _contact,
    "convection_law": _convection_law,
    "thermal_mass": _thermal_mass,
    "path": _path,
}
