"""A method turns a trace's sensors into an estimate of the ambient, whatever stands behind it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from ambient_trainer.data.trace import Array, Trace

Variant = Literal["corrected", "as_printed", "noncausal", "published_parameters", "ours"]


@dataclass(frozen=True)
class Method:
    """A named way to estimate the ambient, trained and ready.

    ``estimate`` gives the ambient in degC, shape (n,), NaN where it has none, from the trace's sensors alone; only the
    variant ``noncausal`` looks at the reference, and is called so wherever it is shown. ``about`` says in a line what
    it is, what was given and what was filled in.
    """

    name: str
    variant: Variant
    estimate: Callable[[Trace], Array]
    about: str
