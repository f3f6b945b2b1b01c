"""A model of one simulated phone."""

import pytest

from ambient_model.model import Model
from ambient_trainer.estimators.base import Effort
from ambient_trainer.estimators.model_file import model_of
from ambient_trainer.estimators.registry import estimator
from ambient_trainer.simulator import simulate

PERIOD_S = 5.0


@pytest.fixture(scope="session")
def free_model() -> Model:
    """A filter of order 2, for a period of 5 s."""
    return model_of(estimator("free-2").fit([simulate("5", period_s=PERIOD_S).trace], Effort(starts=1)), [], {})
