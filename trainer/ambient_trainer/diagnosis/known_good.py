"""Training of a circuit on known-good records of a device: the diagnosis then asks what has changed since.

The circuit's numbers get a prior from them: moving a number in a later fit costs as much as it would make these records
worse, each in proportion to what it leaves anyway. What good records lack of the circuit is added to it first.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ambient_trainer.circuits.circuit import Circuit
from ambient_trainer.data.trace import Array, Trace
from ambient_trainer.diagnosis.findings import residuals_degC
from ambient_trainer.diagnosis.greybox.file import greybox_of
from ambient_trainer.diagnosis.greybox.model import GreyBox
from ambient_trainer.diagnosis.greybox.regression import Fitted, Prior, expected_start, fit, simulate
from ambient_trainer.diagnosis.greybox.revision import refit_as
from ambient_trainer.diagnosis.greybox.screening import permanent_candidates
from ambient_trainer.diagnosis.greybox.stepwise import Progress, bare_fit, stepwise
from ambient_trainer.diagnosis.record import Record, records_of

_FINEST_DEGC = 1e-3
"""Minimum noise of a sensor."""


@dataclass(frozen=True)
class KnownGood:
    """The circuit as known-good records have it, with the mechanisms that they need, and what they leave.

    ``noise_degC`` (s,) is the root mean square of what is left at each sensor, ``rmse_degC`` that of all on records
    that were left out; both of readings as they are.
    """

    model: GreyBox
    prior: Prior
    period_s: float
    noise_degC: Array
    rmse_degC: float

    def records(self, traces: Sequence[Trace]) -> list[Record]:
        """The records of traces, each sensor weighed by its noise."""
        weight = np.sqrt(np.mean(self.noise_degC**2)) / self.noise_degC
        every = [each for trace in traces for each in records_of(self.model.circuit, trace, self.period_s)]
        return [replace(each, weight=weight) for each in every]

    def simulated_degC(self, trace: Trace) -> Array:
        """What each sensor reads on the first record of ``trace``, (s, N), begun at its first readings."""
        record = self.records([trace])[0]
        start, _ = expected_start(self.model, record)
        return simulate(self.model, record, self.model.z()[None], start[None])[0]

    def bare_fit(self, records: Sequence[Record]) -> Fitted:
        """Fit of the circuit to other records, with the known-good ones as prior."""
        found = fit(self.model, records, prior=self.prior)
        assert found is not None, "what was fitted can be simulated"
        return found.refitted()


def train_on_baselines(
    circuit: Circuit, traces: Sequence[Trace], period_s: float, progress: Progress | None = None
) -> KnownGood:
    """A forward ``circuit`` fitted to known-good traces, with what they need besides."""
    good = [each for trace in traces for each in records_of(circuit, trace, period_s)]
    bare = bare_fit(greybox_of(circuit), good)
    final = _drop_slow_masses(stepwise(bare, progress=progress, offered=permanent_candidates).final)
    noise = np.maximum(np.sqrt(np.nanmean(residuals_degC(final) ** 2, axis=1)), _FINEST_DEGC)
    return KnownGood(final.model, Prior.trained(final), period_s, noise, final.held_out_rmse_degC)


def _drop_slow_masses(fitted: Fitted) -> Fitted:
    """Remove masses slower than the records, and what acts on them: each would absorb later changes."""
    model = fitted.model
    slow = next((index for index, each in enumerate(model.mechanisms) if each.slow), None)
    if slow is None:
        return fitted
    gone = [model.mechanisms[slow], *model.carried(slow)]
    less = refit_as(fitted, replace(model, mechanisms=tuple(each for each in model.mechanisms if each not in gone)))
    # without it another one may have become as slow
    return fitted if less is None else _drop_slow_masses(less)
