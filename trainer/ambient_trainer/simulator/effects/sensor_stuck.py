"""A sensor sticks at one value; its last digit flickers now and then."""

import numpy as np

from ambient_trainer.data.trace import Array
from ambient_trainer.simulator.hidden import Acting, Effect, Figure, Ran

_FLICKERS = 0.02  # share of the samples
_DRAWN_DEGC = (15.0, 40.0)


class SensorStuck(Effect):
    """One reading for all; without a size the one that it had."""

    rank = 9
    unit, low, high = "degC", -60.0, 150.0
    meaning = "what is reported; none given: what it read then"
    at, needs_size = "sensors", False

    def drawn_size(self, typical: float, sign: float, chance: float, signal: str | None) -> float:
        """Any value, whatever the scale."""
        low, high = _DRAWN_DEGC
        return round(low + (high - low) * chance, 1)

    def read(self, acting: Acting, reading_degC: Array, step_degC: float) -> Array:
        sticking, size, random = acting.lasts, acting.hidden.size, acting.random()
        value = size if size is not None else reading_degC[int(np.argmax(sticking))]
        flicker = random.choice([-1.0, 1.0], len(reading_degC)) * (random.random(len(reading_degC)) < _FLICKERS)
        stuck = np.round((np.round(value / step_degC) + flicker) * step_degC, 6)
        return np.where(sticking, stuck, reading_degC)

    def magnitude(self, ran: Ran) -> Figure:
        reading = ran.trace.columns[f"{ran.hidden.location}_degC"][ran.there[ran.driven.run.unrecorded :]]
        return float(np.median(reading)), "degC", {}


EFFECT = SensorStuck()
