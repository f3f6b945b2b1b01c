"""Export of a fitted system as a model file: discretised at every period, with a test vector and provenance.

The provenance holds the traces that it was trained on, and the baseline that was fitted beside it; both are read again.
"""

import datetime
import math
import platform
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import scipy
from pydantic import BeforeValidator

from ambient_model import __version__
from ambient_model.codec import decode, encode
from ambient_model.conformance import conformance_of
from ambient_model.faults import refuse
from ambient_model.model import Estimator, Input, Matrix, Model, ReadingModel, Secondary
from ambient_model.trace import split_column
from ambient_trainer.data.strict_yaml import Strict, validated
from ambient_trainer.data.trace import Array, Trace, sha256_of
from ambient_trainer.estimators.base import STATIC_LINEAR, Fit
from ambient_trainer.estimators.estimate import matrix, recursion
from ambient_trainer.lti.statespace import equilibrium

MAIN, SECONDARY, WITHOUT = "main", "guard", "without {}"
"""Names of a model's estimators, the fallbacks' by their input: as model files have called them from the first."""
DEFAULT_PERIODS_S = (0.1, 0.2, 0.5, 1.0)
_MARGIN_K = 30.0
_RANGE_DEGC = (-45.0, 130.0)
"""What a sensor of a device can read; error codes such as 200 lie outside."""
_CONFORMANCE_ROWS = 24
_OF_THE_FIT = ("rmse_degC", "samples", "converged", "uncertainty_available", "identifiable", "stopped")


def model_of(
    fit: Fit, training: Sequence[Mapping[str, Any]], zones: Mapping[str, str], readings: ReadingModel | None = None
) -> Model:
    """The model file of ``fit``, at 1, 2, 5 and 10 Hz and the periods it was trained at.

    ``training`` is the provenance of each trace (see :func:`training_of`); ``zones`` maps input names to thermal zone
    types where they differ; ``readings`` is what a device expects of its sensors. Raises :class:`Refused` where the fit
    estimates something else than the ambient.
    """
    if fit.outputs != ("ambient",):
        what = ", ".join(fit.outputs)
        raise refuse(fit.circuit, "outputs", f"it predicts {what}", "a device runs a circuit whose output is 'ambient'")
    names = [split_column(column)[0] for column in fit.inputs]
    require_zones(zones, names)
    inputs = {column: _input(column, span, zones) for column, span in zip(fit.inputs, fit.input_ranges)}
    estimator = _estimator(fit, inputs)
    model = Model(
        name=fit.circuit,
        created=datetime.datetime.now(datetime.timezone.utc).isoformat(timespec="seconds"),
        output="ambient",
        main=estimator,
        fallbacks={without: _estimator(each, inputs) for without, each in fit.fallbacks.items()},
        provenance=_provenance(fit, training),
        conformance=conformance_of(estimator, _conformance_inputs(fit)),
        secondary=fit.secondary and Secondary(_estimator(fit.secondary.fit, inputs), fit.secondary.threshold_degC),
        error_variance=fit.error_variance,
        readings=readings,
    )
    # whatever a device would refuse is refused here, before anything is scored or written
    return decode(encode(model).encode(), fit.circuit)


def estimators_of(model: Model) -> dict[str, Estimator]:
    """A model's estimators by name."""
    fallbacks = {WITHOUT.format(name): each for name, each in model.fallbacks.items()}
    second = {} if model.secondary is None else {SECONDARY: model.secondary.estimator}
    return {MAIN: model.main, **fallbacks, **second}


def with_estimators(model: Model, changed: Mapping[str, Estimator]) -> Model:
    """``model`` with others in the places of :func:`estimators_of`."""
    second = model.secondary and model.secondary._replace(estimator=changed[SECONDARY])
    fallbacks = {name: changed[WITHOUT.format(name)] for name in model.fallbacks}
    return model._replace(main=changed[MAIN], secondary=second, fallbacks=fallbacks)


def require_zones(zones: Mapping[str, str], names: Sequence[str]) -> None:
    """Refuse the zones of what is none of the inputs' ``names``."""
    unknown = sorted(set(zones) - set(names))
    if unknown:
        raise refuse("zones", "", f"{', '.join(unknown)}: no such input", f"inputs are {', '.join(names)}")


def training_of(trace: Trace, from_s: float | None, to_s: float | None) -> dict[str, Any]:
    """The provenance of a trace that a model was trained on."""
    sha256 = trace.sha256 or sha256_of(trace.path)
    return {"trace": Path(trace.path).name, "sha256": sha256, "from_s": from_s, "to_s": to_s}


def _estimator(fit: Fit, inputs: Mapping[str, Input]) -> Estimator:
    """``inputs`` are those of the whole model by column: a fallback takes the same readings."""
    periods_s = sorted({*DEFAULT_PERIODS_S, *fit.periods_s})
    return Estimator(
        inputs=tuple(inputs[column] for column in fit.inputs),
        states=fit.states,
        discrete=tuple(recursion(fit.system, each, fit.hold) for each in periods_s),
        offset=float(fit.system.offset[0]),
        initial=matrix(equilibrium(fit.system)),
        interval=fit.interval_degC,
    )


def _input(column: str, span: tuple[float, float], zones: Mapping[str, str]) -> Input:
    """A reading counts between -45 and 130 degC, or 30 K (of another unit, the span) beyond the training data.

    The range drops error codes, not conditions that training lacks: a model trained in a mild room runs in a hot one.
    """
    name, unit = split_column(column)
    margin = _MARGIN_K if unit == "degC" else span[1] - span[0]
    low, high = span[0] - margin, span[1] + margin
    if unit == "degC":
        low, high = min(round(low, 3), _RANGE_DEGC[0]), max(round(high, 3), _RANGE_DEGC[1])
    return Input(name, unit, zones.get(name, name), low, high)


def _conformance_inputs(fit: Fit) -> Matrix:
    """Every input in turn steps to the top of its range, then all of them change at random."""
    low, high = np.array(fit.input_ranges).T
    count = len(low)
    drawn = np.random.default_rng(1).uniform(size=(max(_CONFORMANCE_ROWS - count - 2, 4), count))
    shares = np.concatenate([np.full((2, count), 0.4), np.where(np.eye(count), 1.0, 0.4), drawn])
    return matrix(np.round(low + shares * (high - low), 3))


def _provenance(fit: Fit, training: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    names = [split_column(column)[0] for column in fit.inputs]
    return {
        "circuit": fit.circuit,
        "training": [dict(each) for each in training],
        "periods_s": list(fit.periods_s),
        "hold": fit.hold,
        "fit": {
            **{name: getattr(fit, name) for name in _OF_THE_FIT},
            "seed": fit.effort.seed,
            "starts": len(fit.start_rmses_degC),
            "pieces": fit.effort.pieces,
            **fit.details,
        },
        "parameters": {each.name: each.value for each in fit.parameters},
        "baseline": {
            "kind": STATIC_LINEAR,
            "gains": dict(zip(names, fit.baseline.gains.tolist())),
            "offset": fit.baseline.offset,
        },
        "versions": {
            "ambientd": __version__,
            "numpy": np.__version__,
            "scipy": scipy.__version__,
            "python": platform.python_version(),
        },
    }


class TrainingSpan(Strict, extra="ignore"):
    """A part of a trace that a model was trained on: from_s <= time_s < to_s, open where there is none."""

    trace: str
    sha256: str
    from_s: float | None = None
    to_s: float | None = None

    def holds_any(self, time_s: Array) -> bool:
        """Whether any of the times (s) lies in it."""
        start = -math.inf if self.from_s is None else self.from_s
        stop = math.inf if self.to_s is None else self.to_s
        return bool(np.any((start <= time_s) & (time_s < stop)))

    def __str__(self) -> str:
        if self.from_s is None and self.to_s is None:
            return f"{self.trace}, whole"
        start = "its start" if self.from_s is None else f"{self.from_s:.10g} s"
        stop = "its end" if self.to_s is None else f"{self.to_s:.10g} s"
        return f"{self.trace}, {start} to {stop}"


class BaselineScores(Strict, extra="ignore"):
    """The static baseline: ambient = sum of gain x input + offset."""

    gains: dict[str, float]
    offset: float


_OF_THIS_KIND = BeforeValidator(lambda it: it if isinstance(it, dict) and it.get("kind") == STATIC_LINEAR else None)


class Provenance(Strict, extra="ignore"):
    """What a model was trained on, and the static linear baseline; None where the file has none or another kind."""

    training: tuple[TrainingSpan, ...] = ()
    baseline: Annotated[BaselineScores | None, _OF_THIS_KIND] = None


class _File(Strict):
    provenance: Provenance


def provenance_of(model: Model) -> Provenance:
    """The provenance in the model file; raises :class:`Refused` for other forms.

    So it does for a baseline that cannot be computed from the model's inputs.
    """
    found = validated(_File, {"provenance": dict(model.provenance)}, f"model {model.name}").provenance
    inputs = [each.name for each in model.main.inputs]
    if found.baseline and (strangers := found.baseline.gains.keys() - set(inputs)):
        problem, hint = f"{', '.join(strangers)}: no input of the model", f"inputs are {', '.join(inputs)}"
        raise refuse(f"model {model.name}", "provenance.baseline.gains", problem, hint)
    return found


def overlaps_training(model: Model, trace: Trace) -> bool:
    """Whether the file of ``trace`` (which may be cut) was trained on, at any of its times."""
    sha256 = trace.sha256 or sha256_of(trace.path)
    spans = provenance_of(model).training
    return any(span.sha256.lower() == sha256 and span.holds_any(trace.time_s) for span in spans)
