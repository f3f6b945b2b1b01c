"""A model is discrete A, B, C, D at one or several periods, with what its inputs are and how wrong it tends to be.

    x[k+1] = A x[k] + B u[k]
    y[k]   = C x[k] + D u[k] + offset
    x[0]   = X0 u[0]

X0 is the thermal equilibrium with the first sample and the same at every period: the trainer chooses the state's
coordinates so (see ``ambient_trainer.lti.discretise``). A device at work is not in equilibrium: a file that says what
its readings are expected to be may also say at which state it is expected to start.
"""

from typing import Any, NamedTuple

Matrix = tuple[tuple[float, ...], ...]
Band = tuple[float, float]
Quantiles = dict[int, Band]

LEVELS_PERCENT = (50, 90, 98)
SCORES = {50: 0.674, 90: 1.645, 98: 2.326}
"""Standard deviations of a normal distribution within which that percentage lies."""
REGRESSORS = ("movement", "guard", "guard_above", "guard_below")
"""Regressors of the error variance: the estimate's rate of change, the main estimate's difference to the secondary one,
and that difference where it is above, and below."""


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


class Secondary(NamedTuple):
    """Secondary estimator, less sensitive to unmeasured heat, and the difference from which on it is blended in."""

    estimator: Estimator
    """It reads the model's inputs, all of them."""
    threshold_degC: float
    """Up to this difference the main estimate is used alone; see :mod:`ambient_model.blend`."""


class Term(NamedTuple):
    """One regressor's contribution to the error variance."""

    of: str
    """One of :data:`REGRESSORS`."""
    lag_s: float
    """The time constant of the low-pass that it is taken from."""
    weight: float


class Beyond(NamedTuple):
    """What the error variance grows by outside of what training has seen."""

    low_degC: float
    """The least estimate of the training."""
    high_degC: float
    """The greatest one."""
    weight: float
    """Of the square of how far an estimate lies beyond them."""


class ErrorVariance(NamedTuple):
    """Model of the estimate's error variance; see :mod:`ambient_model.error_variance`."""

    constant_degC2: float
    terms: tuple[Term, ...]
    quantiles: Quantiles
    """Per level in percent the error, in standard deviations, it lies between."""
    beyond: Beyond | None = None


class SensorLimits(NamedTuple):
    """What one sensor's readings have shown in training, with a margin; see :mod:`ambient_model.validation`."""

    step: float
    """The resolution."""
    jump: float
    """The largest change within ``ReadingModel.jump_s``."""
    gate: float
    """The largest difference of a reading to its expectation."""
    slow_gate: float
    """The same of its low-pass filtered difference."""
    still_s: float
    """The longest time for which it reads the same while others move."""
    memory_s: float
    """Time constant with which a difference is forgotten while readings are missing."""
    effect_degC: float
    """Standard deviation of the estimate's change where this sensor reports whole units."""
    turn: float = 0.0
    """How far its difference to its expectation may change within ``ReadingModel.jump_s`` while no other sensor moves.

    0 where that is not judged.
    """
    start: float = 0.0
    """The largest difference to its expectation where all low-pass filters have the readings' values, as at a start."""


class ReadingModel(NamedTuple):
    """Joint distribution of the readings and of their low-pass filters: what each reading is expected to be.

    The vector z holds the m readings, then their low-pass filters with the first lag, and so on.
    """

    lags_s: tuple[float, ...]
    mean: tuple[float, ...]
    """Of z."""
    precision: Matrix
    """Inverse covariance of z."""
    sensors: tuple[SensorLimits, ...]
    """One per input of the model."""
    jump_s: float
    settled_s: float
    """Time after a start until the estimate's error has come within 20 % of its usual size."""
    output: Band
    """Least and largest ambient that is published, in degC."""
    rate_K_per_s: float
    """The fastest change of the ambient that is published."""
    starts: tuple[Matrix, ...] = ()
    """The expected state per unit of the first readings, in place of X0: the main estimator's, the secondary one's."""
    offset_gains: Matrix = ()
    """By what factors the slow differences of all readings make each sensor's own constant error."""
    offset_std_degC: float = 0.0
    """Standard deviation of what these errors make of the estimate at rest, from unit to unit; 0 where not known."""


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
    secondary: Secondary | None = None
    """The file's key ``guard``."""
    error_variance: ErrorVariance | None = None
    """The file's key ``spread``."""
    readings: ReadingModel | None = None
