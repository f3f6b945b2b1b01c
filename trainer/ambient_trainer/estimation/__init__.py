"""From traces to parameters: signals, separable least squares, search, uncertainty, validation, error variance."""

from ambient_trainer.estimation.budget import Budget, Cancelled, CancelToken
from ambient_trainer.estimation.error_variance import fit_error_variance, sigma_degC
from ambient_trainer.estimation.search import SearchResult, Solution
from ambient_trainer.estimation.structure import Structure
from ambient_trainer.estimation.uncertainty import Uncertainty
from ambient_trainer.estimation.validation import cut_in_blocks, refitted

__all__ = [
    "Budget",
    "CancelToken",
    "Cancelled",
    "SearchResult",
    "Solution",
    "Structure",
    "Uncertainty",
    "cut_in_blocks",
    "fit_error_variance",
    "refitted",
    "sigma_degC",
]
