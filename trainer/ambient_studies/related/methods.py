"""The four related methods, trained on the same data; each is causal and reads sensors alone."""

from __future__ import annotations

from ambient_studies.related import chau, he, ishii, li
from ambient_studies.related.samples import require
from ambient_trainer.data.trace import Trace
from ambient_trainer.estimators.method import Method

TRAINING_COLUMNS = tuple(dict.fromkeys((*chau.SENSORS, *chau.DRIVES, *he.SENSORS, *ishii.SENSORS, *li.SENSORS)))


def related_methods(training: Trace, idle: Trace) -> list[Method]:
    """The methods of Chau, He, Ishii and Li, fitted to ``training``; Chau's to the idle phone in ``idle`` too.

    Whoever evaluates on scenario 1 takes another run of it for ``idle``. Raises :class:`Refused` where a column is
    missing.
    """
    require(training, TRAINING_COLUMNS)
    return [
        Method(
            "chau_linear_battery",
            "corrected",
            chau.fit([training, idle]).estimate,
            "Chau 2019: a line of the battery temperature, out of a pocket. Given: the regression, the idle phone. "
            "Filled in: when a phone counts as idle",
        ),
        Method(
            "he_svr",
            "corrected",
            he.fit(training).estimate,
            "He, Lee, Shin 2020: support vector regression of battery temperature and discharge current. Given: "
            "inputs, quadratic kernel. Filled in: scaling, C and epsilon by blocked cross-validation",
        ),
        Method(
            "ishii_transfer_functions",
            "corrected",
            ishii.fit(training).estimate,
            "Ishii, Nakashima 2017: heat sources by a steady linear model, the ambient through first-order responses. "
            "Given: the two models. Filled in: which sensors, and least squares with positive resistances and time "
            "constants",
        ),
        Method(
            "li_fixed_point",
            "corrected",
            li.fit(training).estimate,
            "Li et al. 2020: a thermal circuit solved for the ambient by fixed-point iteration. Given: that. Filled "
            "in: the circuit (a surface between USB port and display, natural convection) and its fit",
        ),
    ]
