"""A model small enough to be computed by hand, and traces made for it."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ambient_model.conformance import conformance_of
from ambient_model.model import Discrete, ErrorVariance, Estimator, Input, Model, Secondary, Term
from ambient_trainer.data.trace import Trace, save_trace

INPUTS = (Input("usb", "degC", "usb-therm", -30.0, 90.0), Input("battery", "degC", "battery", -30.0, 90.0))
BASELINE = {"kind": "static linear", "gains": {"usb": 1.25, "battery": -0.3}, "offset": 0.5}


def two_sensor_model(provenance: dict[str, Any] | None = None, periods_s: tuple[float, ...] = (1.0,)) -> Model:
    """One state that follows the battery with 20 s; the ambient is usb minus a part of what the state lags behind."""
    discrete = []
    for period_s in periods_s:
        a = float(np.exp(-period_s / 20.0))
        discrete.append(Discrete(period_s, ((a,),), ((0.0, 1.0 - a),), ((-0.4,),), ((1.3, 0.1),)))
    estimator = Estimator(
        inputs=INPUTS,
        states=("slow",),
        discrete=tuple(discrete),
        offset=-1.5,
        initial=((0.0, 1.0),),
        interval={50: (-0.2, 0.3), 90: (-0.6, 0.7), 98: (-1.0, 1.0)},
    )
    conformance = conformance_of(estimator, ((20.0, 21.0), (22.0, 23.0), (21.0, 25.0)))
    return Model("two sensors", "2024-01-01T00:00:00Z", "ambient_degC", estimator, {}, provenance or {}, conformance)


def guarded_model() -> Model:
    """The same with a secondary estimator that has two lags in a row on usb, and an error variance of all terms."""
    model, a, b = two_sensor_model(), float(np.exp(-1.0 / 15.0)), float(np.exp(-1.0 / 60.0))
    discrete = Discrete(1.0, ((a, 0.0), (1 - b, b)), ((1 - a, 0.0), (0.0, 0.0)), ((0.0, 1.0),), ((0.0, 0.0),))
    both = ((1.0, 0.0), (1.0, 0.0))
    estimator = Estimator(INPUTS, ("once", "twice"), (discrete,), -1.0, both, model.main.interval)
    lags = (("movement", 120.0, 0.5), ("movement", 30.0, 2.0), ("guard", 60.0, 0.25), ("guard", 9.0, 0.1))
    terms = tuple(Term(*each) for each in lags)
    spread = ErrorVariance(0.04, terms, {50: (-0.6, 0.7), 90: (-1.5, 1.8), 98: (-2.4, 2.5)})
    return model._replace(secondary=Secondary(estimator, 1.5), error_variance=spread)


def sensor_trace(samples: int, seed: int = 1, period_s: float = 1.0) -> Trace:
    """Two wandering sensors and a reference somewhere below them."""
    rng = np.random.default_rng(seed)
    time_s = np.arange(samples) * period_s
    usb = 25.0 + np.cumsum(rng.normal(0.0, 0.1, samples))
    battery = usb + 2.0 + np.cumsum(rng.normal(0.0, 0.05, samples))
    reference = usb - 3.0 + rng.normal(0.0, 0.4, samples)
    return Trace("made.csv", time_s, {"usb_degC": usb, "battery_degC": battery, "ambient_degC": reference})


@pytest.fixture
def files(saved, tmp_path: Path) -> Callable[..., tuple[str, str]]:
    def save(trace: Trace, provenance: dict[str, Any] | None = None) -> tuple[str, str]:
        save_trace(str(tmp_path / "trace.csv"), trace)
        return saved(two_sensor_model(provenance)), str(tmp_path / "trace.csv")

    return save
