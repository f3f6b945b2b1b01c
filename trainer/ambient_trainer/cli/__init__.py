"""The command line: one module a command, each a thin call into the package that does the work."""

from ambient_trainer.cli.options import (
    Finite,
    FiniteRange,
    jobs_option,
    output_options,
    sampling_option,
    seed_option,
    whole_numbers,
)
from ambient_trainer.cli.output import Output, check_outputs
from ambient_trainer.cli.progress import counted_progress, staged_progress

__all__ = [
    "Finite",
    "FiniteRange",
    "Output",
    "check_outputs",
    "counted_progress",
    "jobs_option",
    "output_options",
    "sampling_option",
    "seed_option",
    "staged_progress",
    "whole_numbers",
]
