"""Offset correction of a unit: a model's mean error at a known ambient is added to the model's offset.

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
from ambient_model.model import Model
from ambient_trainer.data.trace import Array, Trace
from ambient_trainer.estimation.uncertainty import autocorrelation_time
from ambient_trainer.estimators.model_file import MAIN, estimators_of, with_estimators
from ambient_trainer.evaluation.evaluate import evaluate_trace
from ambient_trainer.report import Finding, Report, Section, Table


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
    errors: dict[str, Array] = {}
    # what each sensor is expected to read is of all sensors, and starts are the main one's
    bare = model._replace(fallbacks={}, secondary=None, error_variance=None, readings=None, provenance={})
    for name, each in estimators_of(model).items():
        alone = bare._replace(main=each)
        error = evaluate_trace(alone, trace, from_s).error_degC
        errors[name] = error[np.isfinite(error)]
    own = errors[MAIN]
    standard_error = float(np.std(own)) * math.sqrt(min(autocorrelation_time(own), len(own)) / len(own))
    return Correction({name: float(np.mean(each)) for name, each in errors.items()}, standard_error, len(own))


def corrected(model: Model, found: Correction, source: Mapping[str, Any]) -> Model:
    """``model`` with its offsets corrected; ``source`` is the provenance of the calibration."""
    offsets = {name: each.offset + found.offsets_degC[name] for name, each in estimators_of(model).items()}
    moved = {name: each._replace(offset=offsets[name]) for name, each in estimators_of(model).items()}
    entry = {**source, **asdict(found)}
    result = with_estimators(model, moved)._replace(
        created=datetime.datetime.now(datetime.timezone.utc).isoformat(timespec="seconds"),
        provenance={**model.provenance, "corrections": [*model.provenance.get("corrections", []), entry]},
        conformance=conformance_of(moved[MAIN], model.conformance.inputs),
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
