"""Errors of a model on data that it was not fitted to, and of an instrument: a probe, a unit, a clock."""

from ambient_trainer.evaluation import correction
from ambient_trainer.evaluation.evaluate import Evaluation, evaluate_trace
from ambient_trainer.evaluation.metrics import ROLLING_LEVEL_PERCENT, ROLLING_SAMPLES, Metrics, rolling_band, score
