"""The experiment that tells apart what the data cannot: what to switch, for how long, and what each cause predicts."""

from ambient_trainer.diagnosis.experiment.choice import next_experiment

__all__ = ["next_experiment"]
