"""From traces to parameters: signals, separable least squares, search, uncertainty, validation, error variance."""

from ambient_trainer.estimation.budget import Budget, Cancelled, CancelToken
from ambient_trainer.estimation.error_variance import fit_error_variance, sigma_degC
from ambient_trainer.estimation.least_squares import Gram
from ambient_trainer.estimation.search import Progress, SearchResult, Solution, search
from ambient_trainer.estimation.structure import Structure, Unknowns
from ambient_trainer.estimation.uncertainty import Uncertainty
from ambient_trainer.estimation.validation import cut_in_blocks, refitted
from ambient_trainer.estimation.workers import results, workers

__all__ = [
    "Budget",
    "CancelToken",
    "Cancelled",
    "Gram",
    "Progress",
    "SearchResult",
    "Solution",
    "Structure",
    "Uncertainty",
    "Unknowns",
    "cut_in_blocks",
    "fit_error_variance",
    "refitted",
    "results",
    "search",
    "sigma_degC",
    "workers",
]
