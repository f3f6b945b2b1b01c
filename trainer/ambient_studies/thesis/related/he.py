"""He, Lee and Shin 2020 (Batteries-as-Thermometers): support vector regression on the battery's own readings.

Given: battery temperature and discharge current go into a support vector regression with a quadratic kernel; 1.25 degC
mean error over six phones, 19 laboratory and 36 field tests; 2 to 3 degC under load, as the thesis quotes it.

Filled in: epsilon-insensitive regression with both inputs standardised and the kernel (1 + x' z)^2, which holds the
linear and constant terms too. C and epsilon come from a cross-validation over five contiguous blocks of the training
trace: neighbouring samples are nearly copies of each other, so a shuffled one would flatter every choice. At most 600
evenly spaced samples are used, as the cost grows faster than their square. The discharge current is the logged battery
current with the other sign, and 0 while charging, when the battery does not discharge: with a negative one the
quadratic would be extrapolated far beyond the training scenario, which never charges.

Source: L. He, Y. Lee, K. G. Shin, "Mobile device batteries as thermometers", Proc. ACM Interact. Mob. Wearable
Ubiquitous Technol. 4(1), article 12, 2020, doi 10.1145/3381015 (its abstract); section 1.1 of the thesis.
"""

from dataclasses import dataclass

import numpy as np
from sklearn.model_selection import GridSearchCV, KFold
from sklearn.pipeline import Pipeline
from sklearn.preprocessing import StandardScaler
from sklearn.svm import SVR

from ambient_studies.thesis.related._samples import Related, training_samples
from ambient_trainer.data import Array, Trace

SENSORS = ("battery_degC", "battery_current_A")

_MOST_SAMPLES = 600
_BLOCKS = 5
_TOLERANCE_DEGC = 0.01
_CHOICES = {"svr__C": [0.1, 1.0, 10.0, 100.0], "svr__epsilon": [0.1, 0.3, 1.0, 3.0]}


@dataclass(frozen=True)
class Regression:
    """A fitted pipeline of ``scale`` and ``svr``, from battery temperature in degC and discharge current in A."""

    pipeline: Pipeline

    def ambient_degC(self, time_s: Array, rows: Array) -> Array:
        """The estimate, shape (n,), from the columns of ``SENSORS`` (2, n)."""
        return np.asarray(self.pipeline.predict(features(rows)))


def features(rows: Array) -> Array:
    """Battery temperature and discharge current (n, 2) from the columns of ``SENSORS`` (2, n)."""
    return np.column_stack([rows[0], np.maximum(-rows[1], 0.0)])


def train(training: Trace) -> Regression:
    """The regression of one trace; raises :class:`Refused` where it is too short."""
    samples = training_samples(training, SENSORS, at_least=2 * _BLOCKS)
    known = np.flatnonzero(~np.isnan(samples.ambient_degC))
    count = min(len(known), _MOST_SAMPLES)
    chosen = known[np.linspace(0, len(known) - 1, count).round().astype(int)]
    svr = SVR(kernel="poly", degree=2, gamma=1.0, coef0=1.0, tol=_TOLERANCE_DEGC)
    search = GridSearchCV(
        Pipeline([("scale", StandardScaler()), ("svr", svr)]),
        _CHOICES,
        scoring="neg_root_mean_squared_error",
        cv=KFold(_BLOCKS, shuffle=False),
    )
    search.fit(features(samples.rows[:, chosen]), samples.ambient_degC[chosen])
    return Regression(search.best_estimator_)


METHOD = Related(
    "he_svr",
    "He, Lee, Shin 2020: support vector regression of battery temperature and discharge current. Given: inputs, "
    "quadratic kernel. Filled in: scaling, C and epsilon by blocked cross-validation",
    SENSORS,
    train,
)
