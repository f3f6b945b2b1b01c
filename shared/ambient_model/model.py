"""A model is discrete A, B, C, D at one or several periods, with what its inputs are and how wrong it tends to be.

    x[k+1] = A x[k] + B u[k]
    y[k]   = C x[k] + D u[k] + offset
    x[0]   = X0 u[0]

X0 is the thermal equilibrium with the first sample and the same at every period: the trainer chooses the state's
coordinates so (see ``ambient_trainer.lti.discretise``).
"""

from typing import Any, NamedTuple

Matrix = tuple[tuple[float, ...], ...]
Band = tuple[float, float]
Quantiles = dict[int, Band]

LEVELS_PERCENT = (50, 90, 98)
UNREST = ("movement", "guard")
"""What the spread may grow with: the estimate's own unrest, its difference to the guard."""


class Input(NamedTuple):
    """One sensor that the model reads."""

    name: str
    unit: str
    zone: str
    """The type of the thermal zone that carries it on the device."""
    min: float
    max: float
    """What lies outside is taken as missing."""

    @property
    def column(self) -> str:
        """Its column in a trace."""
        return f"{self.name}_{self.unit}"


class Discrete(NamedTuple):
    """The recursion at one period: A (n x n), B (n x m), C (1 x n), D (1 x m)."""

    period_s: float
    A: Matrix
    B: Matrix
    C: Matrix
    D: Matrix


class Estimator(NamedTuple):
    """One set of inputs and the recursion from them to the ambient."""

    inputs: tuple[Input, ...]
    states: tuple[str, ...]
    discrete: tuple[Discrete, ...]
    offset: float
    initial: Matrix
    """X0 (n x m)."""
    interval: Quantiles
    """Per level in percent the error (true minus estimate, degC) it lies between."""


class Guard(NamedTuple):
    """A second opinion, which the heat that nobody logs hardly moves, and from where on the two disagree."""

    estimator: Estimator
    """It reads the model's inputs, all of them."""
    threshold_degC: float
    """Up to this difference the main estimator is believed; see :mod:`ambient_model.guard`."""


class Term(NamedTuple):
    """What one kind of unrest adds to the variance of the estimate."""

    of: str
    """One of :data:`UNREST`."""
    lag_s: float
    """The time constant of the low-pass that it is taken from."""
    weight: float


class Spread(NamedTuple):
    """How wrong the estimate is to be thought of just now; see :mod:`ambient_model.spread`."""

    constant_degC2: float
    terms: tuple[Term, ...]
    quantiles: Quantiles
    """Per level in percent the error, in standard deviations, it lies between."""


class Conformance(NamedTuple):
    """An input sequence and what the recursion must make of it."""

    inputs: Matrix
    outputs: dict[float, tuple[float, ...]]
    """Per period in s, one output per input row."""


class Model(NamedTuple):
    """A model file."""

    name: str
    created: str
    output: str
    main: Estimator
    fallbacks: dict[str, Estimator]
    """Per input that may be missing, the estimator that does without it."""
    provenance: dict[str, Any]
    conformance: Conformance
    guard: Guard | None = None
    spread: Spread | None = None
