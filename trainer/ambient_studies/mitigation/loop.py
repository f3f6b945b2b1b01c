"""The closed loop: phones in rooms, a model on their sensors as on a device, governors that use its estimate.

A governor gets its sensor, the estimate and the SoC's power; only with :attr:`Knowledge.TRUTH` the true ambient.
"""

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ambient_model.faults import refuse
from ambient_model.model import Model
from ambient_model.observer import Observer
from ambient_model.tracking import COASTING, DEGRADED, TRACKING, Tracker, nearest_discrete
from ambient_studies.mitigation.governor import Governor, Identified
from ambient_studies.mitigation.setting import Case, Knowledge, Room, Setting
from ambient_trainer.data import Array
from ambient_trainer.simulator import HeatBalance, Progress, Run, Sensors, Zone, bursts, integrate, load_device, stream

TRUSTED = (TRACKING, DEGRADED, COASTING)
"""With any other status the governor assumes the hottest room."""

SKIN = ("display", "back", "frame")
"""The nodes of the phone's surface."""


def skin_degC(nodes_degC: Array) -> Array:
    """The hottest surface node, shape (...), of nodes of shape (..., nodes)."""
    hottest: Array = nodes_degC[..., [load_device().index(node) for node in SKIN]].max(axis=-1)
    return hottest


@dataclass(frozen=True)
class LoopLog:
    """The signals of one phone, each of shape (n,); the work begins at 0 s."""

    case: Case
    time_s: Array
    air_degC: Array
    skin_degC: Array
    soc_W: Array
    used_degC: Array
    """The ambient that its governor used; NaN without a governor."""
    estimate_degC: Array
    """The model's estimate; NaN where there is none."""
    trusted: NDArray[np.bool_]
    """Whether the governor used the estimate."""


def closed_loop(
    model: Model,
    identified: Identified,
    setting: Setting,
    rooms: Sequence[Room],
    seeds: Sequence[int],
    progress: Progress | None = None,
) -> list[LoopLog]:
    """A record for every room, seed and :class:`Knowledge`; raises :class:`Refused` where the phone lacks an input."""
    cases = [Case(*each) for each in itertools.product(rooms, seeds, Knowledge)]
    zones = phone_zones(model, identified.sensor)
    names = [zone.name for zone in zones]
    runs = [_run(case, setting) for case in cases]
    sensors = Sensors([run.device for run in runs], zones, setting.period_s, [case.seed for case in cases])
    assumed = np.array(
        [setting.usual_degC if each.knowledge is Knowledge.USUAL else setting.hottest_degC for each in cases]
    )
    governor = Governor(identified, setting.limit_degC, _most_W(setting), setting.period_s, assumed)
    free, knowing = (
        np.array([each.knowledge is kind for each in cases]) for kind in (Knowledge.NOTHING, Knowledge.TRUTH)
    )
    update = _estimator(model, cases, names, setting.period_s)
    sensor = names.index(identified.sensor)
    time_s: Array = (np.arange(setting.samples, dtype=np.float64) - setting.idle_samples) * setting.period_s
    air_degC, outage = np.stack([run.air_degC for run in runs], axis=1), setting.outage
    kept = np.full((3, *air_degC.shape), np.nan)

    def control(k: int, nodes_degC: Array, drawn_W: Array) -> Array:
        readings, now_s = sensors.read(nodes_degC), float(time_s[k])
        if outage is not None and 60 * outage.from_min <= now_s < 60 * outage.to_min:
            readings[:, names.index(outage.sensor)] = np.nan
        estimate, trusted = update(now_s, readings)
        known = np.where(trusted, estimate, np.where(knowing, air_degC[k], np.nan))
        cap_W = np.where(free, np.inf, governor.cap_W(readings[:, sensor], known, drawn_W))
        kept[:, k] = np.where(free, np.nan, governor.ambient_degC), estimate, trusted
        return cap_W

    done = integrate(runs, setting.period_s, progress, control=control)
    return [
        LoopLog(case, time_s, run.air_degC, skin_degC(each.nodes_degC), each.processor_W, used, estimate, trusted > 0)
        for case, run, each, (used, estimate, trusted) in zip(cases, runs, done, kept.transpose(2, 0, 1))
    ]


def phone_zones(model: Model, sensor: str) -> list[Zone]:
    """The zones of the phone that ``model`` and a governor on ``sensor`` read; raises :class:`Refused`."""
    known = {zone.name: zone for zone in load_device().zones}
    lacking = [each.column for each in model.main.inputs if each.unit != "degC" or each.name not in known]
    if lacking:
        problem = f"reads {', '.join(lacking)}, which the simulated phone has no zone for"
        raise refuse(f"model '{model.name}'", "inputs", problem, "fit one to `ambient-trainer simulate 5`")
    if sensor not in known:
        raise refuse("--sensor", "", f"the simulated phone has no zone '{sensor}'", f"it has {', '.join(known)}")
    return [known[name] for name in dict.fromkeys([*(each.name for each in model.main.inputs), sensor])]


def _estimator(
    model: Model, cases: Sequence[Case], names: Sequence[str], period_s: float
) -> Callable[[float, Array], tuple[Array, NDArray[np.bool_]]]:
    """The model with its secondary estimator, on the readings of each phone whose governor uses the estimate.

    From a time and readings to the estimates, NaN for none, and whether they are trusted, both of shape (batch,).
    """
    discrete = nearest_discrete(model.main, period_s)
    picks = [names.index(each.name) for each in model.main.inputs]
    estimating = [index for index, case in enumerate(cases) if case.knowledge is Knowledge.ESTIMATE]
    observers = {index: Observer(model, Tracker(model.main, discrete)) for index in estimating}

    def update(now_s: float, readings: Array) -> tuple[Array, NDArray[np.bool_]]:
        estimates, trusted = np.full(len(cases), np.nan), np.zeros(len(cases), dtype=np.bool_)
        for index, observer in observers.items():
            row = readings[index, picks].tolist()
            estimate = observer.update(now_s, [None if value != value else value for value in row])
            if estimate.ambient_degC is not None:
                estimates[index], trusted[index] = estimate.ambient_degC, estimate.status in TRUSTED
        return estimates, trusted

    return update


def _run(case: Case, setting: Setting) -> Run:
    idle, count, phone = setting.idle_samples, setting.samples, setting.phone
    air_degC = case.room.air_degC(idle, count, setting.period_s, stream(case.seed, f"room {case.room.name}"))
    activity = np.full(count, phone.activity_index([setting.workload]))
    activity[:idle] = phone.activity_index([])
    burst = np.ones(count)
    if swing := phone.activities[setting.workload].bursts:
        time_s: Array = np.arange(count, dtype=np.float64) * setting.period_s
        burst[idle:] = bursts(time_s, swing, stream(case.seed, "bursts"))[idle:]
    return Run(phone, float(air_degC[0]), air_degC, activity, burst, idle)


def _most_W(setting: Setting) -> float:
    """The highest SoC power of any activity."""
    every = np.arange(len(setting.phone.activities))
    balance = HeatBalance([setting.phone] * len(every))
    return float(balance.demand(every, np.ones(len(every))).heat_W[:, balance.processor].max())
