"""From traces to parameters: separable least squares, search, uncertainty, validation, error variance."""

from ambient_trainer.estimation.circuit_structure import CircuitStructure
from ambient_trainer.estimation.free_filter import FreeFilter, WeightedRun, weighted_filter
from ambient_trainer.estimation.search import Budget, MultistartResult, Progress, search
from ambient_trainer.estimation.structure import Structure, Unknowns
from ambient_trainer.estimation.workers import results, workers
