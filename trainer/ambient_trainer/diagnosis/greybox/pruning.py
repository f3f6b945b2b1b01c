"""What is needless goes: mechanisms, and places of heat, without which a model does as well."""

import logging

import numpy as np

from ambient_trainer.diagnosis.greybox.choice import LEAST_GAIN
from ambient_trainer.diagnosis.greybox.model import GreyBox, Mechanism
from ambient_trainer.diagnosis.greybox.regression import Fitted, fit
from ambient_trainer.diagnosis.greybox.trials import PENALTY, complexity

_log = logging.getLogger(__name__)


def _without_a_place(mechanism: Mechanism) -> list[Mechanism]:
    """A mechanism without each of its places, where each has numbers of its own."""
    count = len(mechanism.places)
    if count < 2 or len(mechanism.numbers) % count:
        return []
    return [mechanism.at_places([each for each in range(count) if each != out]) for out in range(count)]


def pruned(fitted: Fitted, given: int, kept: int) -> Fitted:
    """The model without mechanisms, and places of heat, that others have made needless.

    The first ``given`` are the circuit's own; the one at ``kept`` stays.
    """
    model = fitted.model
    for index, mechanism in list(enumerate(model.mechanisms))[given:]:
        # what acts for a while was gained on short stretches, and is judged by its folds: it has to be quite needless
        assumed = complexity(mechanism) if mechanism.lasts else 0.0
        less = [] if model.carries(index) or index == kept else [(model.without(index), assumed)]
        if mechanism.cause == "heat_source":
            fewer = _without_a_place(mechanism)
            less += [(model.replaced(index, each), assumed - complexity(each)) for each in fewer]
        for each, spared in less:
            most = LEAST_GAIN / 2 + PENALTY * spared
            without = beside(fitted, each, float(np.exp(most + LEAST_GAIN)) * fitted.rmse_degC)
            if without and np.log(without.held_out_rmse_degC / fitted.held_out_rmse_degC) <= most:
                _log.info("dropped %s, or a place of it", mechanism)
                return pruned(without, given, kept - (index < kept and len(each.mechanisms) < len(model.mechanisms)))
    return fitted


def beside(fitted: Fitted, model: GreyBox, most_degC: float = np.inf) -> Fitted | None:
    """Another model on the records of a fit, by the same measure; None where it leaves more than ``most_degC``."""
    other = fit(model, fitted.records, [None for _ in fitted.runs], tolerance=1e-3, prior=fitted.prior)
    if other is None or other.rmse_degC > most_degC:
        return None
    # to first order, or by fits without each fold
    return other if fitted.validated is None else other.refitted()
