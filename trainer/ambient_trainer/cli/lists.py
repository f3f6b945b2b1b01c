"""Lists in one option, such as ``--seeds 3,4,5``."""

from __future__ import annotations

import click


def whole_numbers(option: str, text: str) -> tuple[int, ...]:
    """The numbers from 0 on that ``text`` lists, each once; raises :class:`click.UsageError`."""
    parts = [part.strip() for part in text.split(",")]
    if not all(part.isascii() and part.isdigit() for part in parts):
        raise click.UsageError(f"{option} {text!r}: write whole numbers with commas between, such as 3,4,5")
    return tuple(dict.fromkeys(map(int, parts)))
