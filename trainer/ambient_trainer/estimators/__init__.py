"""What fits a model to traces, and the fitted systems as model files."""

from ambient_trainer.estimators.base import STATIC_LINEAR, USUAL, Effort, Fit, slowest_period_s, source_of
from ambient_trainer.estimators.estimate import estimate_degC
from ambient_trainer.estimators.library.free import FreeFilterEstimator
from ambient_trainer.estimators.model_file import model_of, overlaps_training, provenance_of, training_of
from ambient_trainer.estimators.readings import reading_model
from ambient_trainer.estimators.registry import CircuitEstimator, estimator, thermal_circuit
