"""How wrong a model is, on data that it did not see."""

from ambient_trainer.evaluation import correction
from ambient_trainer.evaluation.evaluate import evaluate_trace
from ambient_trainer.evaluation.metrics import ROLLING_LEVEL_PERCENT, ROLLING_SAMPLES, Metrics, rolling_band, score

__all__ = [
    "ROLLING_LEVEL_PERCENT",
    "ROLLING_SAMPLES",
    "Metrics",
    "correction",
    "evaluate_trace",
    "rolling_band",
    "score",
]
