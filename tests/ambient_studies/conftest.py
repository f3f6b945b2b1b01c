"""A model that has the same estimate for every reading."""

from collections.abc import Callable

import pytest

from ambient_model.model import Model

from .mitigation.sample_report import constant_model


@pytest.fixture
def constant() -> Callable[..., Model]:
    return constant_model
