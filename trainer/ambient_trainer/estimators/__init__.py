"""What fits a model to traces, and the fitted systems as model files."""

from ambient_trainer.estimators.base import USUAL, Effort, Fit
from ambient_trainer.estimators.estimate import estimate_degC
from ambient_trainer.estimators.library.free import FreeFilterEstimator
from ambient_trainer.estimators.registry import estimator, thermal_circuit
