"""Models whose estimate is known in closed form, and traces that are wrong by a known amount."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from ambient_model.codec import decode, encode
from ambient_model.conformance import conformance_of
from ambient_model.model import Discrete, Estimator, Input, Model, Secondary
from ambient_trainer.data.trace import Trace
from ambient_trainer.estimators.fit import Effort, fit_free_filter
from ambient_trainer.estimators.model_file import model_of
from ambient_trainer.simulator.simulate import simulate

PERIOD_S = 5.0
INPUTS = (Input("usb", "degC", "usb", -45.0, 130.0), Input("display", "degC", "display", -45.0, 130.0))


def weighted(inputs: tuple[Input, ...], weights: tuple[float, ...], offset: float) -> Estimator:
    """No memory: the weighted mean of the sensors."""
    discrete = tuple(Discrete(period_s, (), (), ((),), (weights,)) for period_s in (1.0, PERIOD_S))
    return Estimator(inputs, (), discrete, offset, (), {50: (-0.1, 0.1), 90: (-0.2, 0.2), 98: (-0.3, 0.3)})


def mean_model(guarded: bool = True) -> Model:
    """Half usb, half display; without usb the display alone; the guard believes usb more."""
    main = weighted(INPUTS, (0.5, 0.5), 1.0)
    model = Model(
        name="mean",
        created="2024-01-01T00:00:00Z",
        output="ambient",
        main=main,
        fallbacks={"usb": weighted(INPUTS[1:], (1.0,), -2.0)},
        provenance={"circuit": "mean"},
        conformance=conformance_of(main, ((20.0, 21.0), (30.0, 28.0))),
        secondary=Secondary(weighted(INPUTS, (0.75, 0.25), 0.5), 1e3) if guarded else None,
    )
    return decode(encode(model).encode(), "mean")


def known_trace(ambient_degC: float = 21.0, samples: int = 400, seed: int = 0) -> Trace:
    """The ambient is constant; usb reads 4 more, display 2 more, both with noise."""
    random = np.random.default_rng(seed)
    columns = {
        "usb_degC": ambient_degC + 4 + 0.1 * random.normal(size=samples),
        "display_degC": ambient_degC + 2 + 0.1 * random.normal(size=samples),
        "ambient_degC": np.full(samples, ambient_degC),
    }
    return Trace("known.csv", np.arange(samples) * 1.0, columns)


@pytest.fixture
def mean() -> Callable[..., Model]:
    return mean_model


@pytest.fixture
def known() -> Callable[..., Trace]:
    return known_trace


@pytest.fixture(scope="session")
def free_model() -> Model:
    """A filter of order 2 of one simulated phone, for a period of 5 s."""
    return model_of(fit_free_filter(2, [simulate("5", period_s=PERIOD_S).trace], Effort(starts=2)), [], {})
