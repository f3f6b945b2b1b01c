"""Where a command prints: as wide as the terminal is, and in a file as wide as the tables are."""

from __future__ import annotations

from rich.console import Console

_WIDTH_OF_A_FILE = 140


def printer() -> Console:
    """Standard output."""
    console = Console(highlight=False)
    if not console.is_terminal:
        console.width = _WIDTH_OF_A_FILE
    return console
