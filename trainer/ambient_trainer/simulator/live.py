"""Chamber, probes and devices second by second, for who asks while they run: the same equations as for a whole run.

A chamber's air is held on a grid of whole seconds from its start; between them it goes straight. What was asked of the
controller counts from the next second on, so nothing that was once read changes any more.
"""

import math
import threading
from collections.abc import Callable, Sequence

import numpy as np

from ambient_trainer.data.trace import Array
from ambient_trainer.lti.lag import lag_weights
from ambient_trainer.simulator.chamber import Chamber, Probes
from ambient_trainer.simulator.device import Device, Zone, load_device
from ambient_trainer.simulator.heat import Demand, HeatBalance, advanced
from ambient_trainer.simulator.run import bursts, stream

_STEP_S = 1.0
_STANDING_S = 1800.0  # how slowly a chamber that is stopped goes back to the room's temperature; chosen


class ChamberAir:
    """Air that follows a set point, from ``room_degC`` at the time ``start_s`` on."""

    def __init__(
        self, start_s: float, room_degC: float, seed: int | np.random.Generator, dynamics: Chamber | None = None
    ) -> None:
        self._random = random = np.random.default_rng(seed)
        self._start_s, self._room_degC = start_s, room_degC
        self._dynamics = dynamics or load_device().chamber
        self._phase = random.uniform(0.0, 2.0 * math.pi)
        self._draught = random.standard_normal()
        self._stir = 0.0
        self._wanted_degC: float | None = None
        self._up_K_min = self._down_K_min = math.inf
        self._ramp_degC = self._mean_degC = room_degC
        self._lock = threading.Lock()
        self._grid_degC = [room_degC]

    def drive(self, at_s: float, wanted_degC: float | None) -> None:
        """Go to ``wanted_degC`` from ``at_s`` on; None is a chamber that is stopped."""
        with self._lock:
            self._advance(at_s)
            self._wanted_degC = wanted_degC

    def limit(self, at_s: float, up_K_min: float, down_K_min: float) -> None:
        """Rise and fall no faster than this from ``at_s`` on; 0.0 is as fast as it can."""
        with self._lock:
            self._advance(at_s)
            self._up_K_min, self._down_K_min = up_K_min or math.inf, down_K_min or math.inf

    def at(self, at_s: float) -> float:
        """The air in degC; a time before the start is the start."""
        with self._lock:
            self._advance(at_s)
            place = max(at_s - self._start_s, 0.0) / _STEP_S
            before = int(place)
            low_degC, high_degC = self._grid_degC[before : before + 2]
            return low_degC + (high_degC - low_degC) * (place - before)

    def _advance(self, at_s: float) -> None:
        while self._start_s + (len(self._grid_degC) - 1) * _STEP_S <= at_s or len(self._grid_degC) < 2:
            before_degC = self._ramp_degC
            if self._wanted_degC is None:
                self._ramp_degC += (self._room_degC - before_degC) * -math.expm1(-_STEP_S / _STANDING_S)
            else:
                up_K = min(self._up_K_min, self._dynamics.heating_K_min) / 60.0 * _STEP_S
                down_K = min(self._down_K_min, self._dynamics.cooling_K_min) / 60.0 * _STEP_S
                self._ramp_degC += min(max(self._wanted_degC - before_degC, -down_K), up_K)
            settling = lag_weights(self._dynamics.settling_s, _STEP_S)
            self._mean_degC = settling.step(self._mean_degC, before_degC, self._ramp_degC)
            stirred = 0.0 if self._wanted_degC is None else 1.0
            self._stir += (stirred - self._stir) * -math.expm1(-_STEP_S / self._dynamics.settling_s)
            kept = math.exp(-_STEP_S / self._dynamics.draught_s)
            self._draught = kept * self._draught + math.sqrt(1.0 - kept * kept) * self._random.standard_normal()
            passed_s = len(self._grid_degC) * _STEP_S
            swing = math.sin(2.0 * math.pi / self._dynamics.wobble_period_s * passed_s + self._phase)
            # a chamber that is stopped lacks both
            unsteady_K = self._dynamics.wobble_degC * swing + self._dynamics.draught_degC * self._draught
            self._grid_degC.append(self._mean_degC + self._stir * unsteady_K)


_THERMOCOUPLE = Probes()
_SETTLED_S = 60.0  # fifteen time constants of a probe: the air before that does not count


class Probe:
    """A thermocouple behind a first-order lag: exact where the air goes straight from second to second."""

    def __init__(self, air: Callable[[float], float], error_K: float, random: np.random.Generator) -> None:
        self._air, self._error_K, self._random = air, error_K, random
        self._last: tuple[float, float, float] | None = None

    def read(self, at_s: float) -> float:
        """What the instrument reads."""
        if self._last is None or at_s - self._last[0] > _SETTLED_S:
            begin_degC = self._air(at_s - _SETTLED_S)
            self._last = (at_s - _SETTLED_S, begin_degC, begin_degC)
        last_s, air_degC, felt_degC = self._last
        steps = math.ceil(at_s - last_s)
        lag = lag_weights(_THERMOCOUPLE.lag_s, max(at_s - last_s, 1e-9) / max(steps, 1))
        for passed_s in np.linspace(0.0, at_s - last_s, steps + 1)[1:]:
            before_degC, air_degC = air_degC, self._air(last_s + float(passed_s))
            felt_degC = lag.step(felt_degC, before_degC, air_degC)
        self._last = (at_s, air_degC, felt_degC)
        noise_K = _THERMOCOUPLE.noise_degC * float(self._random.standard_normal())
        return round(felt_degC + self._error_K + noise_K, _THERMOCOUPLE.digits)


class Sensors:
    """The sensors of some zones of a batch of devices of one kind, sample by sample ``period_s`` apart.

    Each has its first-order lag, exact for a straight line, and the noise that a whole run with its device's seed has.
    """

    def __init__(self, devices: Sequence[Device], zones: Sequence[Zone], period_s: float, seeds: Sequence[int]) -> None:
        self._zones, self._seeds = tuple(zones), tuple(seeds)
        self._weights = np.array([[device.felt_weights(zone) for zone in zones] for device in devices])
        self._lag = lag_weights([zone.lag_s for zone in zones], period_s)
        self._random = {seed: [stream(seed, f"zone {zone.name}") for zone in zones] for seed in seeds}
        self._under: Array | None = None

    def read(self, nodes_degC: Array) -> Array:
        """What they report, shape (batch, zones), of the next sample's nodes; at the first one they are settled."""
        before, self._under = self._under, np.einsum("bzn,bn->bz", self._weights, nodes_degC)
        self._felt: Array = self._under if before is None else self._lag.step(self._felt, before, self._under)
        drawn = {seed: [each.standard_normal() for each in random] for seed, random in self._random.items()}
        noise = np.array([drawn[seed] for seed in self._seeds])
        columns = [zone.reported(self._felt[:, k], noise[:, k]) for k, zone in enumerate(self._zones)]
        return np.stack(columns, axis=1)


class LiveDevice:
    """The device with its ``zones``, settled in the air of ``start_s`` while it does ``activity``.

    The noise of ``seed`` counts from ``start_s``, bursts from ``recording_s`` later, as in a scenario with that much
    before its recording.
    """

    def __init__(
        self,
        device: Device,
        zones: Sequence[Zone],
        air_degC: Callable[[float], float],
        start_s: float,
        activity: str,
        seed: int = 0,
        recording_s: float = 0.0,
    ) -> None:
        self.device, self._air_degC, self._start_s = device, air_degC, start_s
        self._seed, self._recording_s = seed, recording_s
        self._balance = HeatBalance([device])
        self._sensors = Sensors([device], zones, _STEP_S, [seed])
        self._seconds = 0
        demand = self._balance.demand(np.array([device.activity_index([activity])]), np.ones(1))
        self._nodes_degC = self._balance.equilibrium(np.array([air_degC(start_s)]), demand)
        self._read(demand)

    @property
    def next_s(self) -> float:
        """When its next second is over."""
        return self._start_s + (self._seconds + 1) * _STEP_S

    def advance(self, now_s: float, activity: str) -> None:
        """Bring it to the last whole second before ``now_s``; what it does not know, it does not do."""
        index = self.device.activity_index([activity] if activity in self.device.activities else [])
        while self.next_s <= now_s:
            swing, burst = tuple(self.device.activities.values())[index].bursts, np.ones(1)
            if swing:
                burst = bursts(np.array([self._seconds - self._recording_s]), swing, stream(self._seed, "bursts"))
            demand = self._balance.demand(np.array([index]), burst)
            at_s = self.next_s - _STEP_S
            air_degC = np.array([self._air_degC(at_s)]), np.array([self._air_degC(at_s + _STEP_S)])
            self._nodes_degC = advanced(self._balance.rates, self._nodes_degC, demand, air_degC, _STEP_S)
            self._read(demand)
            self._seconds += 1

    def _read(self, demand: Demand) -> None:
        self.current_A = float(self._balance.drawn(self._nodes_degC, demand)[1][0])
        """Into the battery."""
        self.zones_degC: list[float] = self._sensors.read(self._nodes_degC)[0].tolist()
        """What the zones report."""
        if battery := self.device.battery:
            self.battery_degC = float(self._nodes_degC[0, self.device.index(battery.node)])
            self.battery_V = battery.volt_V + self.current_A * battery.ohm
            """With the drop in its own resistance."""
