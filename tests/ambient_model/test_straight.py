"""The usual sample as straight-line code does to the last bit what the loops do, and takes nearly every sample."""

import random

import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from ambient_model.model import Conformance, Discrete, Estimator, Input, Model, ReadingModel, SensorLimits
from ambientd.fallback import FallbackTracker

SAMPLES = 200
REST_DEGC = 25.0
QUANTILES = {50: (-0.1, 0.1), 90: (-0.3, 0.3), 98: (-0.5, 0.5)}


def reading_model(count: int, seed: int) -> ReadingModel:
    """Sensors that go together, with gates that noise meets now and then."""
    z = 3 * count
    own = np.random.default_rng(seed).normal(size=(z, z)) * 0.05
    precision = np.linalg.inv(100 * np.ones((z, z)) + own @ own.T + 0.01 * np.eye(z))
    return ReadingModel(
        lags_s=(30.0, 300.0),
        mean=(REST_DEGC,) * z,
        precision=tuple(map(tuple, ((precision + precision.T) / 2).tolist())),
        sensors=(SensorLimits(0.1, 1.0, 0.6, 0.05, 40.0, 60.0, 0.2, 0.5),) * count,
        jump_s=1.0,
        settled_s=20.0,
        output=(-20.0, 60.0),
        rate_K_per_s=0.5,
    )


def samples(model: Model, period_s: float, trouble: float, seed: int):
    """Times and readings; ``trouble`` is the share of samples that are late, or lack or distort a reading."""
    draw = random.Random(seed)
    readings = [REST_DEGC] * len(model.main.inputs)
    time_s = 0.0
    for _ in range(SAMPLES):
        time_s += period_s
        i = draw.randrange(len(readings))
        readings = [*readings]
        readings[i] = round(REST_DEGC + draw.gauss(0, 0.1), 1)
        given = [*readings]
        if draw.random() < trouble:
            given[i] = draw.choice([None, 0.0, 1e4, REST_DEGC + draw.uniform(-8, 8)])
            time_s += draw.choice([0.0, 0.0, draw.uniform(0, 3), 40.0, -5.0]) * period_s
        yield time_s + draw.uniform(-0.2, 0.2) * period_s, given


def both(model: Model, period_s: float, level: int) -> tuple[FallbackTracker, FallbackTracker]:
    straight, loops = (FallbackTracker(model, period_s, level) for _ in range(2))
    loops._update_usual = lambda time_s, readings: None
    return straight, loops


@pytest.mark.parametrize("validated", [False, True])
@given(st.from_type(Model), st.integers(0, 2**32), st.sampled_from(list(QUANTILES)), st.sampled_from([0.0, 0.01, 0.1]))
@settings(max_examples=60, phases=(Phase.explicit, Phase.generate))
def test_it_is_to_the_last_bit_what_the_loops_do(validated, model, seed, level, trouble):
    if validated:
        model = model._replace(readings=reading_model(len(model.main.inputs), seed))
    period_s = model.main.discrete[0].period_s
    straight, loops = both(model, period_s, level)
    for time_s, readings in samples(model, period_s, trouble, seed):
        assert straight.update(time_s, readings) == loops.update(time_s, readings)
    assert straight.snapshot() == loops.snapshot()


def test_it_takes_nearly_every_sample_and_looks_at_what_stands_still():
    inputs = tuple(Input(name, "degC", name, -40.0, 90.0) for name in "abcd")
    main = Estimator(inputs, (), (Discrete(10.0, (), (), ((),), ((0.25,) * 4,)),), 0.0, (), QUANTILES)
    readings = reading_model(4, 1)
    calm = tuple(each._replace(gate=6.0, slow_gate=6.0, still_s=600.0) for each in readings.sensors)
    model = Model("calm", "now", "ambient", main, {}, {}, Conformance((), {}), readings=readings._replace(sensors=calm))
    straight, loops = both(model, 10.0, 90)
    usual, taken = straight._update_usual, []
    straight._update_usual = lambda *sample: taken.append(usual(*sample)) or taken[-1]
    for time_s, row in samples(model, 10.0, 0.0, 1):
        assert straight.update(time_s, row) == loops.update(time_s, row)
    assert sum(each is not None for each in taken) > 0.9 * SAMPLES
