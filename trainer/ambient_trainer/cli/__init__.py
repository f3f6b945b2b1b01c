"""The command line: one module a command, each a thin call into the package that does the work."""

from ambient_trainer.cli.options import (
    Finite,
    FiniteRange,
    assigned,
    circuit_option,
    effort_options,
    jobs_option,
    names,
    output_options,
    period_option,
    sampling_option,
    seed_option,
    sensors_option,
    starts_option,
    whole_numbers,
    window_options,
)
from ambient_trainer.cli.output import Output, printer
from ambient_trainer.cli.progress import counted_progress, fit_progress, staged_progress
