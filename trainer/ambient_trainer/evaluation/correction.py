"""A unit's correction: a model's mean error on it, while the ambient is known, is added to the model's offset.

Each estimator of the file (the main one, the secondary one, every fallback) is corrected by its own mean error, run
over the calibration from its first sample on as on the device. Gains stay as they are: ten minutes at one temperature
determine no more than a constant.
"""

import datetime
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from ambient_model.codec import decode, encode
from ambient_model.conformance import conformance_of
from ambient_model.model import Estimator, Model
from ambient_trainer.data.trace import Array, Trace
from ambient_trainer.estimation.uncertainty import residual_memory
from ambient_trainer.evaluation.evaluate import evaluate_trace
from ambient_trainer.report import Finding, Report, Section, Table

MAIN, SECONDARY = "main", "guard"
"""As model files have named them from the first."""


@dataclass(frozen=True)
class Correction:
    """What is added to the offsets, in degC: of ``main``, of ``guard``, and of the fallback ``without <input>``."""

    offsets_degC: Mapping[str, float]
    standard_error_degC: float
    """Of the main one's."""
    samples: int


def correction(model: Model, trace: Trace, from_s: float | None = None, to_s: float | None = None) -> Correction:
    """The mean errors of ``model`` between from_s and to_s; it runs from the start of ``trace`` on.

    Raises :class:`Refused` where a column or the ambient is missing.
    """
    trace = trace.cut(None, to_s)
    estimators = {MAIN: model.main} | {f"without {name}": each for name, each in model.fallbacks.items()}
    if model.secondary is not None:
        estimators[SECONDARY] = model.secondary.estimator
    errors: dict[str, Array] = {}
    for name, each in estimators.items():
        # what each sensor is expected to read is of all sensors, and starts are the main one's
        alone = model._replace(
            main=each, fallbacks={}, secondary=None, error_variance=None, readings=None, provenance={}
        )
        error = evaluate_trace(alone, trace, from_s).error_degC
        errors[name] = error[np.isfinite(error)]
    own = errors[MAIN]
    standard_error = float(np.std(own)) * math.sqrt(min(residual_memory(own), len(own)) / len(own))
    return Correction({name: float(np.mean(each)) for name, each in errors.items()}, standard_error, len(own))


def corrected(model: Model, found: Correction, source: Mapping[str, Any]) -> Model:
    """``model`` with its offsets corrected; ``source`` is the provenance of the calibration."""
    added = found.offsets_degC
    main = _moved(model.main, added[MAIN])
    entry = {**source, **asdict(found)}
    result = model._replace(
        created=datetime.datetime.now(datetime.timezone.utc).isoformat(timespec="seconds"),
        main=main,
        fallbacks={name: _moved(each, added[f"without {name}"]) for name, each in model.fallbacks.items()},
        secondary=model.secondary
        and model.secondary._replace(estimator=_moved(model.secondary.estimator, added[SECONDARY])),
        provenance={**model.provenance, "corrections": [*model.provenance.get("corrections", []), entry]},
        conformance=conformance_of(main, model.conformance.inputs),
    )
    # whatever a device would refuse is refused here, before anything is written
    return decode(encode(result).encode(), model.name)


def report_of(found: Correction) -> Report:
    """The report of a correction."""
    added, error = found.offsets_degC[MAIN], found.standard_error_degC
    small = "It is within twice its standard error of 0: the device was hardly off, or logged too briefly."
    rows = [(name, f"{degC:+.3f}") for name, degC in found.offsets_degC.items() if name != MAIN]
    return Report(
        subject="Correction",
        title=f"Offset {added:+.3f} degC (standard error {error:.3f}), from {found.samples:,} samples with an ambient",
        lead=[Finding(small) if abs(added) < 2 * error else None],
        sections=[Section("", [Table("", ("estimator", "offset in degC"), rows) if rows else None])],
        data=asdict(found),
    )


def _moved(estimator: Estimator, degC: float) -> Estimator:
    return estimator._replace(offset=estimator.offset + degC)
