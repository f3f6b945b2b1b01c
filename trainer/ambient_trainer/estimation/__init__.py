"""From traces to parameters: separable least squares, search, uncertainty, validation, error variance."""

from ambient_trainer.estimation.search import Progress, search
from ambient_trainer.estimation.structure import Structure, Unknowns
from ambient_trainer.estimation.workers import results, workers
