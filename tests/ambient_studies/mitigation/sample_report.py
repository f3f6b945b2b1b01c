"""A comparison of synthetic records, as a report."""

from functools import cache
from typing import Any

import numpy as np

from ambient_model.conformance import conformance_of
from ambient_model.model import Discrete, Estimator, Input, Model
from ambient_studies.mitigation.comparison import Comparison
from ambient_studies.mitigation.governor import Identified
from ambient_studies.mitigation.loop import LoopLog
from ambient_studies.mitigation.report import report_of
from ambient_studies.mitigation.setting import Case, Knowledge, Room, Setting
from ambient_trainer.lti import StateSpace
from ambient_trainer.report import Report
from ambient_trainer.simulator import load_device

SETTING = Setting(work_min=10.0, idle_min=5.0)
STANDBY_W = load_device().activities["idle"].heat_W["soc"]


def first_order(resistance_K_W: float = 3.0, time_constant_s: float = 300.0, share: float = 0.25) -> Identified:
    """In steady state the skin is ``share`` of the sensor and the rest of the ambient; the sensor acts with the lag."""
    rate = 1.0 / time_constant_s
    A, B, C, D = [[-rate]], [[share * rate, 0.0]], [[1.0]], [[0.0, 1.0 - share]]
    skin = StateSpace(*map(np.array, (A, B, C, D, [0.0])))
    return Identified("soc", skin, "first-order", 0.1, 0.5, resistance_K_W, time_constant_s)


def constant_model(estimate_degC: float, sensor: str = "usb") -> Model:
    """A model with the same estimate for every reading."""
    inputs = (Input(sensor, "degC", f"{sensor}-therm", -45.0, 130.0),)
    bands = {50: (-0.1, 0.1), 90: (-0.2, 0.2), 98: (-0.3, 0.3)}
    estimator = Estimator(inputs, (), (Discrete(1.0, (), (), ((),), ((0.0,),)),), estimate_degC, (), bands)
    conformance = conformance_of(estimator, ((20.0,), (30.0,)))
    return Model("constant", "2024-01-01T00:00:00Z", "ambient_degC", estimator, {}, {}, conformance)


def record_of(knowledge: Knowledge, watts: float, skin_degC: float, error_degC: float | None = None) -> LoopLog:
    """Five minutes idle at 99 degC and 50 W, then 10 min of work: skin at 30 degC, ``skin_degC`` in the last two."""
    time_s = np.arange(-300.0, 600.0)
    skin = np.where(time_s < 0, 99.0, np.where(time_s < 480, 30.0, skin_degC))
    power_W = np.where(time_s < 0, 50.0, STANDBY_W + watts)
    air = np.full(900, 20.0)
    estimate = np.full(900, np.nan) if error_degC is None else air + error_degC
    trusted = np.full(900, error_degC is not None)
    return LoopLog(Case(Room((20.0,)), 1, knowledge), time_s, air, skin, power_W, air, estimate, trusted)


def runs(**changes: LoopLog) -> list[LoopLog]:
    """A record for each knowledge; ``changes`` replaces some by name."""
    usual = {
        "NOTHING": record_of(Knowledge.NOTHING, 4.0, 45.0),
        "HOTTEST": record_of(Knowledge.HOTTEST, 1.0, 38.0),
        "USUAL": record_of(Knowledge.USUAL, 3.0, 42.0),
        "ESTIMATE": record_of(Knowledge.ESTIMATE, 2.0, 39.0, error_degC=0.5),
        "TRUTH": record_of(Knowledge.TRUTH, 2.0, 39.5),
    }
    return list({**usual, **changes}.values())


def comparison(**settings: Any) -> Comparison:
    setting = Setting(**{"work_min": 10.0, "idle_min": 5.0, **settings})
    return Comparison(constant_model(20.5), first_order(), setting, tuple(runs()))


@cache
def samples() -> dict[str, Report]:
    return {"mitigation": report_of(comparison())}
