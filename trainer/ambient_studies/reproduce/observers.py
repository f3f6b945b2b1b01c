"""The two observers as methods beside the thesis's models: fitted to the same run, over the same five sensors."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from ambient_trainer.data.grid import sampling_period_s
from ambient_trainer.data.trace import Trace
from ambient_trainer.estimators.estimate import estimate_degC
from ambient_trainer.estimators.fit import Effort, Fit
from ambient_trainer.estimators.method import Method
from ambient_trainer.estimators.registry import estimator

_SENSORS = ("soc_degC", "flash_degC", "battery_degC", "usb_degC", "display_degC")
_EFFORT = Effort(starts=1)
"""As for the thesis's models."""
_PERIOD_S = 5.0
"""Nothing in a phone is faster; the fits are, for it."""

Progress = Callable[[str, int, int], None]
"""Told what is being done, how much of it is done and how much there is."""


def observer_methods(training: Trace, progress: Progress) -> list[Method]:
    """``circuit_observer`` and ``free_observer``, fitted to ``training``; each is causal and reads sensors alone."""
    period_s = max(_PERIOD_S, sampling_period_s(training.time_s))
    progress("fitting circuit_observer", 0, 2)
    circuit = estimator("circuit_observer").fit([training], _EFFORT, None, period_s, _SENSORS)
    progress("fitting free_observer", 1, 2)
    free = estimator("free_observer").fit([training], _EFFORT, None, period_s, _SENSORS)
    return [
        _method(
            circuit, "the nodes that the sensors read, each exchanging heat with the ambient, which walks at random"
        ),
        _method(free, "a free linear filter whose gains at rest add up to one, its order chosen on the training run"),
    ]


def _method(fit: Fit, about: str) -> Method:
    return Method(fit.circuit, "ours", partial(estimate_degC, fit.system, fit.hold, fit.inputs), about)
