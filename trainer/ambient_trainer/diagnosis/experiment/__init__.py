"""The experiment that distinguishes what the data do not: what to switch, for how long, and what each predicts."""

from ambient_trainer.diagnosis.experiment.proposal import next_experiment

__all__ = ["next_experiment"]
