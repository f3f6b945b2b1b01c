"""A model as the README's demo fits it, a governor known in closed form, and one closed loop for all tests."""

from collections.abc import Callable

import pytest

from ambient_model.model import Model
from ambient_studies.mitigation.comparison import identify, settling_min, training_trace
from ambient_studies.mitigation.governor import Identified
from ambient_studies.mitigation.loop import Record, closed_loop
from ambient_studies.mitigation.setting import Room, Setting
from ambient_trainer.data import Trace
from ambient_trainer.estimators.base import Effort
from ambient_trainer.estimators.library.free import FreeFilterEstimator
from ambient_trainer.estimators.model_file import model_of
from ambient_trainer.simulator import load_device, simulate

from .sample_report import first_order

COLD, HOT, WALK = Room((5.0,)), Room((35.0,)), Room((35.0, 5.0, 35.0))


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
    return Setting(work_min=36.0, idle_min=settling_min(model, 4.0), period_s=4.0)


@pytest.fixture(scope="session")
def records(model: Model, identified: Identified, setting: Setting) -> list[Record]:
    """Two seeds in a cold and in a hot room, and walking from the one to the other and back."""
    return closed_loop(model, identified, setting, [COLD, HOT, WALK], [1, 2])


@pytest.fixture
def governor_of() -> Callable[..., Identified]:
    return first_order
