"""What a command shows: as wide as the terminal is, in a file as wide as the tables are, and as JSON for a machine."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import click
from rich.console import Console

from ambient_model.atomic import replacing

_WIDTH_OF_A_FILE = 140


def printer() -> Console:
    """Standard output."""
    console = Console(highlight=False)
    if not console.is_terminal:
        console.width = _WIDTH_OF_A_FILE
    return console


def write_figures(path: str, data: Mapping[str, Any]) -> None:
    """Write ``data`` as JSON, whole or not at all, and say so."""
    write_json(path, data)
    click.echo(f"Figures: {path}")


def write_page(folder: str, page: str) -> None:
    """Write a report's page into ``folder``, and say where it is."""
    from ambient_trainer.report.page import write_report  # jinja2: only a report should wait for it

    click.echo(f"Report: {write_report(folder, page)}")


def write_json(path: str, data: Mapping[str, Any]) -> None:
    """Write ``data`` as JSON, whole or not at all; a number that is none is an error."""
    with replacing(path) as stream:
        json.dump(data, stream, indent=1, allow_nan=False)
        stream.write("\n")
