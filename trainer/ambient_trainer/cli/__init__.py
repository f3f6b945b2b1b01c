"""The command line: one module a command, each a thin call into the package that does the work.

The names below are imported when they are first used: ``ambient-trainer --help`` must not wait for rich.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
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

_PLACES = {
    **dict.fromkeys(("Output", "check_outputs"), "output"),
    **dict.fromkeys(("counted_progress", "staged_progress"), "progress"),
}
"""The modules of names outside :mod:`.options`."""


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(f"{__name__}.{_PLACES.get(name, 'options')}"), name)
