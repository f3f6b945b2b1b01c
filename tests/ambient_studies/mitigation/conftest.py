"""A model as the README's demo fits it, a governor known in closed form, and one closed loop for all to look at."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from ambient_model.conformance import conformance_of
from ambient_model.model import Discrete, Estimator, Input, Model
from ambient_studies.mitigation.comparison import settling_min
from ambient_studies.mitigation.governor import Identified
from ambient_studies.mitigation.loop import Record, closed_loop
from ambient_studies.mitigation.room import Room
from ambient_studies.mitigation.setting import Setting
from ambient_studies.mitigation.training import identify, training_trace
from ambient_trainer.data.trace import Trace
from ambient_trainer.estimators.base import Effort
from ambient_trainer.estimators.library.free import FreeFilterEstimator
from ambient_trainer.estimators.model_file import model_of
from ambient_trainer.lti.statespace import StateSpace
from ambient_trainer.simulator.device_file import load_device
from ambient_trainer.simulator.simulate import simulate

COLD, HOT, WALK = Room((5.0,)), Room((35.0,)), Room((35.0, 5.0, 35.0))


def first_order(resistance_K_W: float = 3.0, time_constant_s: float = 300.0, share: float = 0.25) -> Identified:
    """At rest the skin is ``share`` of the sensor and the rest of the ambient; the sensor acts with the phone's lag."""
    rate = 1.0 / time_constant_s
    skin = StateSpace(
        np.array([[-rate]]),
        np.array([[share * rate, 0.0]]),
        np.array([[1.0]]),
        np.array([[0.0, 1.0 - share]]),
        np.array([0.0]),
    )
    return Identified("soc", skin, "first-order", 0.1, 0.5, resistance_K_W, time_constant_s)


def constant_model(said_degC: float) -> Model:
    """A model that says the same whatever it reads."""
    estimator = Estimator(
        (Input("usb", "degC", "usb-therm", -45.0, 130.0),),
        (),
        (Discrete(1.0, (), (), ((),), ((0.0,),)),),
        said_degC,
        (),
        {50: (-0.1, 0.1), 90: (-0.2, 0.2), 98: (-0.3, 0.3)},
    )
    conformance = conformance_of(estimator, ((20.0,), (30.0,)))
    return Model("constant", "2024-01-01T00:00:00Z", "ambient_degC", estimator, {}, {}, conformance)


@pytest.fixture(scope="session")
def trained() -> Trace:
    """The governor's training run."""
    return training_trace(load_device().zone("soc"))


@pytest.fixture(scope="session")
def identified(trained: Trace) -> Identified:
    return identify(trained)


@pytest.fixture(scope="session")
def logged() -> Trace:
    return simulate("5").trace


@pytest.fixture(scope="session")
def model(logged: Trace) -> Model:
    """As ``ambient-trainer simulate 5`` and ``fit --circuit free-2`` make it."""
    return model_of(FreeFilterEstimator(2).fit([logged], Effort(starts=3)), [], {})


@pytest.fixture(scope="session")
def setting(model: Model) -> Setting:
    return Setting(work_min=36.0, idle_min=settling_min(model, 1.0))


@pytest.fixture(scope="session")
def records(model: Model, identified: Identified, setting: Setting) -> list[Record]:
    """Two seeds in a cold and in a hot room, and walking from the one to the other and back."""
    return closed_loop(model, identified, setting, [COLD, HOT, WALK], [1, 2])


@pytest.fixture
def governor_of() -> Callable[..., Identified]:
    return first_order


@pytest.fixture
def saying() -> Callable[[float], Model]:
    return constant_model
