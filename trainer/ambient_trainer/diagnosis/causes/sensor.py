"""The instrument, not the heat: one sensor reads with a bias, a wrong gain, late, always the same, or ever more."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from ambient_trainer.diagnosis.candidate import Candidate, Estimate, Parameters, Setting, Span
from ambient_trainer.diagnosis.result import Cause, Magnitude
from ambient_trainer.diagnosis.terms import DriftTerm, SensorTerm, lag
from ambient_trainer.diagnosis.view import View

BIAS, GAIN, LAG, STUCK, DRIFT = "sensor_bias", "sensor_gain", "sensor_lag", "sensor_stuck", "sensor_drift"
_ABOUT_DEGC = 25.0
_LONGEST_LAG_S = 3600.0
_LAGS = 6


def candidates(setting: Setting) -> Iterator[Candidate]:
    """Every sensor, every way."""
    for sensor, name in enumerate(setting.plant.sensors):
        window = setting.flat[sensor]
        if window is not None:
            # what stands still is stuck: every other fault would have to imitate that
            yield replace(_stuck(sensor, name), window=window)
            continue
        yield _biased(sensor, name)
        yield _scaled(sensor, name)
        yield _drifting(sensor, name)
        fastest = 0.5 * setting.plant.period_s
        for lag_s in np.geomspace(fastest, max(_LONGEST_LAG_S, 40 * fastest), _LAGS):
            yield _late(setting, sensor, name, float(lag_s))


def _biased(sensor: int, name: str) -> Candidate:
    def terms(view: View) -> tuple[SensorTerm, ...]:
        return (SensorTerm(sensor, np.ones_like),)

    def magnitude(found: Estimate) -> Magnitude:
        return Magnitude(float(found.values[0]), "degC", f"what {name} reads too much", found.interval(0))

    return Candidate(Cause(BIAS, name), Span.WINDOW, terms, magnitude, faulty=frozenset((sensor,)))


def _scaled(sensor: int, name: str) -> Candidate:
    def terms(view: View) -> tuple[SensorTerm, ...]:
        return SensorTerm(sensor, lambda reading: reading - _ABOUT_DEGC), SensorTerm(sensor, np.ones_like)

    def magnitude(found: Estimate) -> Magnitude:
        meaning = f"relative error of {name}'s slope"
        return Magnitude(float(found.values[0]), "1", meaning, found.interval(0))

    def parameters(found: Estimate) -> Parameters:
        return {
            "gain": (1.0 + float(found.values[0]), "1"),
            "bias_at_25_degC": (float(found.values[1]), "degC"),
        }

    return Candidate(
        Cause(GAIN, name),
        Span.WINDOW,
        terms,
        magnitude,
        parameters,
        fixed=(None, None),
        plausible=lambda values: np.abs(values[..., 0]) < 0.9,
        faulty=frozenset((sensor,)),
    )


def _stuck(sensor: int, name: str) -> Candidate:
    def terms(view: View) -> tuple[SensorTerm, ...]:
        return SensorTerm(sensor, np.ones_like), SensorTerm(sensor, lambda reading: -reading)

    def magnitude(found: Estimate) -> Magnitude:
        return Magnitude(float(found.values[0]), "degC", f"what {name} always reads", found.interval(0))

    return Candidate(Cause(STUCK, name), Span.WINDOW, terms, magnitude, fixed=(None, 1.0), faulty=frozenset((sensor,)))


def _drifting(sensor: int, name: str) -> Candidate:
    def terms(view: View) -> tuple[DriftTerm, ...]:
        return (DriftTerm(sensor),)

    def magnitude(found: Estimate) -> Magnitude:
        meaning = f"how {name}'s error grows"
        return Magnitude(3600.0 * float(found.values[0]), "K/h", meaning, found.interval(0, 3600.0))

    return Candidate(Cause(DRIFT, name), Span.ONSET, terms, magnitude, faulty=frozenset((sensor,)))


def _late(setting: Setting, sensor: int, name: str, lag_s: float) -> Candidate:
    def terms(view: View) -> tuple[SensorTerm, ...]:
        return (SensorTerm(sensor, lambda reading: lag(reading, lag_s, view.plant.period_s) - reading),)

    def magnitude(found: Estimate) -> Magnitude:
        spread = found.deviation(1)
        return Magnitude(
            lag_s,
            "s",
            f"time constant of a lag of {name}",
            (lag_s * max(0.0, 1.0 - 1.96 * spread), lag_s * (1.0 + 1.96 * spread)),
        )

    return Candidate(
        Cause(LAG, name),
        Span.WINDOW,
        terms,
        magnitude,
        fixed=(1.0,),
        shape=lag_s,
        faulty=frozenset((sensor,)),
        reshaped=lambda shape: _late(setting, sensor, name, shape),
    )
