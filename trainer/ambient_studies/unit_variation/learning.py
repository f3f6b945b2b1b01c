"""A unit learns its offset as the device does: from a week of one reading of the room a day."""

from collections.abc import Sequence

import numpy as np

from ambient_model.tracking import Estimate
from ambient_model.unit_offset import LEARNING, OffsetPrior, estimate_variance_degC2, initial, predicted, updated
from ambient_studies.unit_variation.runs import ON_BEFORE_MIN
from ambient_trainer.evaluation import Evaluation
from ambient_trainer.simulator import stream

DAYS = 7
READING_SIGMA_DEGC = 0.5
LIE_DEGC = 10.0
_DAY_S = 86400.0
_LEVEL_PERCENT = 90


def learnt(number: int, seed: int, days: Sequence[Evaluation], lie_degC: float = 0.0) -> list[float]:
    """The offset in degC after each day of a unit that rests, one run a day.

    A reading at a random moment of the last ten minutes is the ambient, a normal error of ``READING_SIGMA_DEGC``, and
    ``lie_degC``. It counts as on the device: in the same statuses, and within the gate.
    """
    random, prior = stream(seed, f"unit {number} readings"), OffsetPrior()
    state, offsets = initial(prior), []
    for day, run in enumerate(days):
        first = int(np.searchsorted(run.time_s, 60 * ON_BEFORE_MIN))
        at = int(random.integers(first, len(run.time_s)))
        reading_degC = run.reference_degC[at] + random.normal(0.0, READING_SIGMA_DEGC) + lie_degC
        state = predicted(prior, state, day * _DAY_S)
        if run.status[at] in LEARNING:
            y, low, high = (float(each[at]) for each in (run.estimate_degC, run.low_degC, run.high_degC))
            estimate = Estimate(y, low, high, str(run.status[at]), ())
            R = READING_SIGMA_DEGC**2 + estimate_variance_degC2(estimate, _LEVEL_PERCENT)
            state = updated(prior, state, reading_degC - y, R) or state
        offsets.append(state.offset_degC)
    return offsets
