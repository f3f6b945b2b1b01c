"""The options that say how hard to work, the same for every command that searches."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import click


def effort_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Give ``command`` --starts, --pieces and --seed, and call it with them as its ``effort``."""

    @click.option(
        "--starts", type=click.IntRange(1, 1000), default=8, show_default=True, help="Searches from so many places."
    )
    @click.option(
        "--pieces",
        type=click.IntRange(1, 10_000),
        default=1,
        show_default=True,
        help="Fit a trace in so many pieces, each from a cold start.",
    )
    @click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Of the places.")
    @functools.wraps(command)
    def with_effort(starts: int, pieces: int, seed: int, **rest: Any) -> Any:
        from ambient_trainer.estimators.fit import Effort  # scipy: --help should not wait for it

        return command(effort=Effort(starts, seed, pieces), **rest)

    return with_effort


def _cores() -> int:
    import joblib  # --help should not wait for it

    return int(joblib.cpu_count())


def jobs_option(meaning: str) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Give a command --jobs: as many processes as there are cores, if nothing else is said."""
    return click.option(
        "--jobs",
        type=click.IntRange(1, 256),
        default=_cores,
        help=f"{meaning} [default: as many as there are cores]",
    )
