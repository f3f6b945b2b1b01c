"""Models of the simulated phone: one that was fitted to what it is scored on, and one that is constant."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from ambient_model.conformance import conformance_of
from ambient_model.model import Discrete, Estimator, Input, Model
from ambient_trainer.estimators.base import Effort
from ambient_trainer.estimators.library.free import FreeFilterEstimator
from ambient_trainer.estimators.model_file import model_of
from ambient_trainer.simulator import simulate_many

SCENARIO, PERIOD_S = "2.5", 5.0


def constant_model(said_degC: float, sensor: str = "usb") -> Model:
    estimator = Estimator(
        (Input(sensor, "degC", sensor, -45.0, 130.0),),
        (),
        (Discrete(PERIOD_S, (), (), ((),), ((0.0,),)),),
        said_degC,
        (),
        {50: (-0.1, 0.1), 90: (-0.2, 0.2), 98: (-0.3, 0.3)},
    )
    return Model(
        "constant", "2024-01-01T00:00:00Z", "ambient", estimator, {}, {}, conformance_of(estimator, ((20.0,),))
    )


@pytest.fixture(scope="session")
def model_of_the_scenario() -> Model:
    """A free filter of order 2, fitted to the scenario itself: to the runs that the bound is fitted to."""
    traces = [each.trace for each in simulate_many([(SCENARIO, seed) for seed in (6, 7, 8)], PERIOD_S)]
    return model_of(FreeFilterEstimator(2).fit(traces, Effort(starts=4)), [], {})


@pytest.fixture
def constant() -> Callable[..., Model]:
    return constant_model
